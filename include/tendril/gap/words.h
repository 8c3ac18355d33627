// Formats numbers for readers: the same unit and rounding in the sentence, on the terminal and on the page.
// Knows nothing of where they appear.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Display unit for values smaller than `below` (in SI): shown = value * factor.
struct ShownUnit {
  double below;
  double factor;
  std::string_view unit;
};
/// By SI unit, each in order of increasing size up to infinity; a unit that is not listed is shown unchanged.
const std::map<std::string_view, std::vector<ShownUnit>>& ShownUnits();

/// "0.31 mm" for 3.1e-4 and "m": three significant digits; "-" when not finite.
std::string WithUnit(double value, std::string_view unit);

/// A multiple of the noise floor with two significant digits: "7.7", "25", "123".
std::string Sigmas(double value);

/// A share in whole percent: "98 %"; ">99 %" and "<1 %" where rounding would give 100 or 0.
std::string Percent(double share);

/// A parameter's name and value, such as "mass 2.04 g", "scale × 1.84", "2.83°": in the unit of its name's
/// suffix, rounded to two digits of its interval and at most four digits. `with_interval` adds " [1.98,
/// 2.10]".
std::string ParameterWords(std::string_view parameter, const Estimate& estimate, bool with_interval);

/// `value` formatted as ParameterWords does, without the name.
std::string ParameterValue(std::string_view parameter, const Estimate& estimate, double value);

}  // namespace tendril::gap
