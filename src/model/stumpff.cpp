// Stumpff functions by power series near zero and by sine and cosine away from it.
// Knows nothing of robots.
#include "tendril/model/stumpff.h"

#include <cmath>

namespace tendril::model {
namespace {

// 1/k!, k = 0..7, and the coefficients of the two highest functions: sixth[j] = 1/(6+2j)!, seventh[j] =
// 1/(7+2j)!.
constexpr int kTerms = 13;

struct Tables {
  std::array<double, kStumpffCount> inverse_factorial{};
  std::array<double, kTerms> sixth{}, seventh{};
};

constexpr Tables MakeTables() {
  Tables t;
  long double f = 1;
  for (int k = 0; k < 6 + 2 * kTerms; ++k) {
    if (k > 0) f *= k;
    const double inverse = static_cast<double>(1 / f);
    if (k < kStumpffCount) t.inverse_factorial[k] = inverse;
    if (k >= 6 && k % 2 == 0) t.sixth[(k - 6) / 2] = inverse;
    if (k >= 7 && k % 2 == 1) t.seventh[(k - 7) / 2] = inverse;
  }
  return t;
}

constexpr Tables kTable = MakeTables();

// Below `kSeriesLimit` the terms of both series fall from the first one on, so nothing cancels in them; the
// downward recurrence loses nothing that matters until theta = pi. Above, 1/k! - c_k is well away from zero
// for every k.
constexpr double kSmallLimit = 1.25, kSeriesLimit = 10;

template <int terms>
void HighestTwo(double x, double& c6, double& c7) {
  double even = kTable.sixth[terms - 1], odd = kTable.seventh[terms - 1];
  for (int j = terms - 2; j >= 0; --j) {
    even = kTable.sixth[j] - x * even;
    odd = kTable.seventh[j] - x * odd;
  }
  c6 = even;
  c7 = odd;
}

}  // namespace

std::array<double, kStumpffCount> Stumpff(double x) noexcept {
  const auto& f = kTable.inverse_factorial;
  std::array<double, kStumpffCount> c;
  if (x < kSeriesLimit) {
    if (x < kSmallLimit) {
      HighestTwo<8>(x, c[6], c[7]);
    } else {
      HighestTwo<kTerms>(x, c[6], c[7]);
    }
    for (int k = 5; k >= 0; --k) c[k] = f[k] - x * c[k + 2];
  } else {
    const double theta = std::sqrt(x);
    c[0] = std::cos(theta);
    c[1] = std::sin(theta) / theta;
    for (int k = 2; k < kStumpffCount; ++k) c[k] = (f[k - 2] - c[k - 2]) / x;
  }
  return c;
}

}  // namespace tendril::model
