// The units that key names may end in, how to print them, and which neighbours people mix them up with.
// Knows nothing of any particular key.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tendril::config {

/// "unit_length_m" -> "m"; empty when the key ends in no unit that Tendril uses.
std::string_view UnitSuffix(std::string_view key);

/// How the unit is written for people: "Nms" -> "N·m·s"; empty for an empty suffix.
std::string_view UnitText(std::string_view suffix);

/// A unit that people write or mean instead of the accepted one.
struct OtherUnit {
  std::string_view suffix;  // in key names, for example "mm"
  std::string_view name;    // "millimetres"
  double factor;            // accepted = factor * other
};

/// The unit named `suffix` where `accepted` belongs, if Tendril knows it.
std::optional<OtherUnit> FindOtherUnit(std::string_view accepted, std::string_view suffix);

/// The other unit in which `value` would lie within [min, max] of the accepted one, if there is one.
std::optional<OtherUnit> GuessOtherUnit(std::string_view accepted, double value, double min, double max);

}  // namespace tendril::config
