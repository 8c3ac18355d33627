// The Stumpff functions against their defining sum in extended precision.
#include "tendril/model/stumpff.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace tendril::model {
namespace {

long double Sum(int k, long double x) {
  long double term = 1;
  for (int i = 2; i <= k; ++i) term /= i;
  long double sum = 0;
  for (int j = 0; j < 80; ++j) {
    sum += term;
    term *= -x / ((k + 2 * j + 1) * (k + 2 * j + 2));
  }
  return sum;
}

std::vector<double> Arguments() {
  constexpr double kPi = std::numbers::pi;
  std::vector<double> xs{0,         1e-300,
                         1e-18,     1e-9,
                         1e-6,      1e-3,
                         kPi * kPi, std::nextafter(0.25, 0),
                         0.25,      std::nextafter(1.25, 0),
                         1.25,      std::nextafter(10.0, 0),
                         10,        4 * kPi * kPi};
  for (double theta = 0.01; theta < 6.5; theta += 0.0137) xs.push_back(theta * theta);
  return xs;
}

TEST(Stumpff, EqualsItsSumToRounding) {
  // One unit in the last place of c_k at the straight shape is epsilon / k!: the size every formula compares
  // with.
  double factorial = 1;
  for (int k = 0; k < kStumpffCount; ++k) {
    if (k > 1) factorial *= k;
    for (const double x : Arguments()) {
      const double error = static_cast<double>(std::abs(Stumpff(x)[k] - Sum(k, x)));
      const double unit = std::numeric_limits<double>::epsilon() / factorial;
      EXPECT_LE(error, (x < 2.5 ? 1.0 : 6.0) * unit) << "c_" << k << "(" << x << ")";
    }
  }
}

TEST(Stumpff, TheFirstOnesAreTheTrigonometricFactorsOfAnArc) {
  for (const double theta : {0.3, 1.0, 2.0, 3.1, 4.0, 6.0}) {
    const auto c = Stumpff(theta * theta);
    EXPECT_NEAR(c[0], std::cos(theta), 1e-15);
    EXPECT_NEAR(c[1], std::sin(theta) / theta, 1e-15);
    EXPECT_NEAR(c[2], (1 - std::cos(theta)) / (theta * theta), 1e-15);
    EXPECT_NEAR(c[3], (theta - std::sin(theta)) / (theta * theta * theta), 1e-15);
  }
}

TEST(Stumpff, DerivativeFollowsTheRecurrence) {
  for (const double x : {0.0, 1e-8, 0.4, 2.0, 9.0, 12.0}) {
    const auto c = Stumpff(x);
    for (int k = 0; k <= 5; ++k) {
      const long double h = 1e-4L;
      const long double slope =
          (8 * (Sum(k, x + h) - Sum(k, x - h)) - (Sum(k, x + 2 * h) - Sum(k, x - 2 * h))) / (12 * h);
      EXPECT_NEAR(StumpffDerivative(c, k), static_cast<double>(slope), 2e-15) << k << " " << x;
    }
  }
}

}  // namespace
}  // namespace tendril::model
