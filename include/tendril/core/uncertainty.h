// How well a number of the robot file is known, before any run is looked at. Knows nothing of files or of what
// the numbers do.
#pragma once

#include <string>
#include <string_view>

namespace tendril {

/// One standard deviation about a number's value.
struct Uncertainty {
  enum class Kind {
    kShare,     // `deviation` is a share of the value: 0.1 for 10 %
    kAbsolute,  // `deviation` in the number's own unit
    kKnown,     // taken as exact
    kUnknown,   // nothing is known but its order of magnitude
  };
  Kind kind = Kind::kShare;
  double deviation = 0;  // kShare and kAbsolute: > 0

  bool operator==(const Uncertainty&) const = default;
};

/// What labs know of a number of this kind where the file does not say, by the last word of its key
/// ("body.sections[1].youngs_modulus_Pa"): lengths and radii to a few per cent, friction to four tenths.
/// Limits, names of objects, counts and what a data sheet fixes are known. See docs/reference/robot-file.md.
Uncertainty UsualUncertainty(std::string_view key);

/// As the robot file says it after `within:`: "10 %", "2e-05", "known", "unknown". Read back, the same.
std::string UncertaintyText(const Uncertainty& uncertainty);

}  // namespace tendril
