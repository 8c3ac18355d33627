// Intervals of 95 %.
#pragma once

namespace tendril::gap {

/// Half of one, in standard deviations.
inline constexpr double kTwoSided95 = 1.959964;

}  // namespace tendril::gap
