// Stumpff functions of wide bends: by longer power series, and by sine and cosine.
// Knows nothing of robots.
#include "tendril/model/stumpff.h"

#include <cmath>

namespace tendril::model::detail {
namespace {

// Below `kSeriesLimit` the terms of both series fall from the first one on, so there is no cancellation; the
// downward recurrence is accurate until theta = pi. Above, 1/k! - c_k is well away from zero for every k.
constexpr double kSmallLimit = 1.25, kSeriesLimit = 10;

}  // namespace

std::array<double, kStumpffCount> FarStumpff(double x) noexcept {
  if (x < kSmallLimit) return StumpffSeries<8>(x);
  if (x < kSeriesLimit) return StumpffSeries<kStumpffTerms>(x);
  const double theta = std::sqrt(x);
  std::array<double, kStumpffCount> c;
  c[0] = std::cos(theta);
  c[1] = std::sin(theta) / theta;
  for (int k = 2; k < kStumpffCount; ++k) {
    c[k] = (kStumpffTable.inverse_factorial[k - 2] - c[k - 2]) / x;
  }
  return c;
}

}  // namespace tendril::model::detail
