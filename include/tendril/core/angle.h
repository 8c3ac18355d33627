// Angles for people: everything computes in radians.
#pragma once

#include <numbers>

namespace tendril {

inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

}  // namespace tendril
