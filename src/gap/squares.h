// Accumulates root mean squares.
#pragma once

#include <cmath>

namespace tendril::gap {

struct Squares {
  double sum = 0, count = 0;
  void Add(double value) { sum += value * value, count += 1; }
  /// 0 without values.
  double rms() const { return count > 0 ? std::sqrt(sum / count) : 0; }
};

}  // namespace tendril::gap
