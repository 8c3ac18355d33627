// Numbers as people read them: one unit and one rounding for a value, whether it stands in the sentence, on
// the terminal or on the page. Knows nothing of where they stand.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// A unit for values of a size `below` this one, in SI: shown = value * factor.
struct ShownUnit {
  double below;
  double factor;
  std::string_view unit;
};
/// By SI unit, each by rising size and up to infinity; a unit that is not listed is shown as it is.
const std::map<std::string_view, std::vector<ShownUnit>>& ShownUnits();

/// "0.31 mm" of 3.1e-4 and "m": three digits; "-" when not finite.
std::string Quantity(double value, std::string_view unit);

/// How many noise floors, in two digits: "7.7", "25", "123".
std::string Sigmas(double value);

/// A share in whole percent: "98 %"; ">99 %" and "<1 %" where rounding would say all or nothing.
std::string Percent(double share);

/// A parameter's name and value, "mass 2.04 g", "scale × 1.84", "2.83°": in the unit that its name ends with,
/// to two digits of its interval and at most four of its own. `with_interval` adds " [1.98, 2.10]".
std::string ParameterWords(std::string_view parameter, const Estimate& estimate, bool with_interval);

/// `value` of the same parameter as ParameterWords writes it, without its name.
std::string ParameterValue(std::string_view parameter, const Estimate& estimate, double value);

}  // namespace tendril::gap
