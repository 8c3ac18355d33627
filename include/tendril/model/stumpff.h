// Stumpff functions c_k(x) = sum_j (-x)^j / (k + 2j)!: every trigonometric factor of a constant-curvature arc, smooth
// through the straight shape. With x = theta^2: c0 = cos(theta), c1 = sin(theta)/theta, c2 = (1 - cos(theta))/theta^2,
// c3 = (theta - sin(theta))/theta^3. Knows nothing of robots.
#pragma once

#include <array>

namespace tendril::model {

inline constexpr int kStumpffCount = 8;

/// c_0 .. c_7 at x >= 0, to a few units in the last place of max(1, |c_k|).
std::array<double, kStumpffCount> Stumpff(double x) noexcept;

/// dc_k/dx = (k c_{k+2} - c_{k+1}) / 2, from values of Stumpff(x); k <= 5.
inline double StumpffDerivative(const std::array<double, kStumpffCount>& c, int k) noexcept {
  return 0.5 * (k * c[k + 2] - c[k + 1]);
}

}  // namespace tendril::model
