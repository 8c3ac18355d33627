// Draws the rounding error of a coarse reading.
#pragma once

#include <cmath>
#include <random>

namespace tendril::gap {

/// Rounding error of a reading within its step: constant while the reading is constant.
class WithinSteps {
 public:
  WithinSteps(double step, std::mt19937_64& random) : part_(-0.5 * step, 0.5 * step), random_(random) {}
  double At(double reading) {
    if (reading != last_) off_ = part_(random_);
    last_ = reading;
    return off_;
  }

 private:
  std::uniform_real_distribution<double> part_;
  std::mt19937_64& random_;
  double last_ = NAN, off_ = 0;
};

}  // namespace tendril::gap
