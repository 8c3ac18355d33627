// Stumpff functions c_k(x) = sum_j (-x)^j / (k + 2j)!: every trigonometric factor of a constant-curvature
// arc, smooth through the straight shape. With x = theta^2: c0 = cos(theta), c1 = sin(theta)/theta, c2 = (1 -
// cos(theta))/theta^2, c3 = (theta - sin(theta))/theta^3. Knows nothing of robots.
#pragma once

#include <array>

namespace tendril::model {

inline constexpr int kStumpffCount = 8;

namespace detail {

// 1/k!, k = 0..7, and the coefficients of the two highest functions: sixth[j] = 1/(6+2j)!, seventh[j] =
// 1/(7+2j)!.
inline constexpr int kStumpffTerms = 13;

struct StumpffTables {
  std::array<double, kStumpffCount> inverse_factorial{};
  std::array<double, kStumpffTerms> sixth{}, seventh{};
};

constexpr StumpffTables MakeStumpffTables() {
  StumpffTables t;
  long double f = 1;
  for (int k = 0; k < 6 + 2 * kStumpffTerms; ++k) {
    if (k > 0) f *= k;
    const double inverse = static_cast<double>(1 / f);
    if (k < kStumpffCount) t.inverse_factorial[k] = inverse;
    if (k >= 6 && k % 2 == 0) t.sixth[(k - 6) / 2] = inverse;
    if (k >= 7 && k % 2 == 1) t.seventh[(k - 7) / 2] = inverse;
  }
  return t;
}

inline constexpr StumpffTables kStumpffTable = MakeStumpffTables();

// The series of the two highest functions, cut after `terms`, and the downward recurrence.
template <int terms>
inline std::array<double, kStumpffCount> StumpffSeries(double x) noexcept {
  const StumpffTables& t = kStumpffTable;
  std::array<double, kStumpffCount> c;
  double even = t.sixth[terms - 1], odd = t.seventh[terms - 1];
  for (int j = terms - 2; j >= 0; --j) {
    even = t.sixth[j] - x * even;
    odd = t.seventh[j] - x * odd;
  }
  c[6] = even;
  c[7] = odd;
  for (int k = 5; k >= 0; --k) c[k] = t.inverse_factorial[k] - x * c[k + 2];
  return c;
}

std::array<double, kStumpffCount> FarStumpff(double x) noexcept;

}  // namespace detail

/// c_0 .. c_7 at x >= 0, to a few units in the last place of max(1, |c_k|).
inline std::array<double, kStumpffCount> Stumpff(double x) noexcept {
  // A unit bent by less than half a radian needs few terms; this is the case in the hot loops.
  constexpr double kNear = 0.25;
  return x < kNear ? detail::StumpffSeries<6>(x) : detail::FarStumpff(x);
}

/// dc_k/dx = (k c_{k+2} - c_{k+1}) / 2, from values of Stumpff(x); k <= 5.
inline double StumpffDerivative(const std::array<double, kStumpffCount>& c, int k) noexcept {
  return 0.5 * (k * c[k + 2] - c[k + 1]);
}

}  // namespace tendril::model
