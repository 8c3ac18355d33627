// The unit suffixes of key names, their printed form, and units that they are confused with. Knows nothing of
// any particular key.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tendril::config {

/// "unit_length_m" -> "m"; empty when the key ends in no unit that Tendril uses.
std::string_view UnitSuffix(std::string_view key);

/// The printed form of a unit: "Nms" -> "N·m·s"; empty for an empty suffix.
std::string_view UnitText(std::string_view suffix);

/// A unit that may be written by mistake instead of the accepted one.
struct OtherUnit {
  std::string_view suffix;  // in key names, for example "mm"
  std::string_view name;    // "millimetres"
  double factor;            // accepted = factor * other
};

/// The unit with this suffix that may stand in for `accepted`, if known.
std::optional<OtherUnit> FindOtherUnit(std::string_view accepted, std::string_view suffix);

/// The other unit in which `value` would lie within [min, max] of the accepted one, if there is one.
std::optional<OtherUnit> GuessOtherUnit(std::string_view accepted, double value, double min, double max);

}  // namespace tendril::config
