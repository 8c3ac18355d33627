// Signals at the samples of a run: gaps, rates, values between samples. Knows nothing of what they measure.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>

namespace tendril::sim {

/// Bridges gaps of NaN linearly, held at the ends; false when there is no value.
bool Bridge(Eigen::Ref<Eigen::VectorXd> values);

/// Rate of a smooth signal on a grid, by central differences of fourth order, lower ones at the ends.
void Differentiate(Eigen::Ref<const Eigen::VectorXd> x, double step, Eigen::Ref<Eigen::VectorXd> rate);

/// Values linear between the samples.
class Grid {
 public:
  /// `samples` at equal steps.
  Grid(double step_s, Eigen::Index samples) : step_(step_s), last_(samples - 1) {}
  /// Samples at these times.
  explicit Grid(Eigen::VectorXd time_s) : last_(time_s.size() - 1), time_s_(std::move(time_s)) {}

  void MoveTo(double time_s) noexcept {
    const double at = time_s_.size() > 0 ? Sample(time_s) : time_s / step_, whole = std::round(at);
    const double before = std::abs(at - whole) < 1e-6 ? whole : std::floor(at);
    fraction_ = at - before < 1e-6 ? 0 : at - before;
    sample_ = std::clamp<Eigen::Index>(static_cast<Eigen::Index>(before), 0, last_);
    if (sample_ == last_) fraction_ = 0;
  }
  Eigen::Index sample() const noexcept { return sample_; }
  double Of(const double* x) const noexcept {
    return fraction_ > 0 ? x[sample_] + fraction_ * (x[sample_ + 1] - x[sample_]) : x[sample_];
  }

 private:
  double Sample(double time_s) const noexcept {
    const double* begin = time_s_.data();
    const Eigen::Index after = std::upper_bound(begin, begin + time_s_.size(), time_s) - begin;
    if (after == 0) return 0;
    if (after > last_) return static_cast<double>(last_);
    return static_cast<double>(after - 1) +
           (time_s - time_s_[after - 1]) / (time_s_[after] - time_s_[after - 1]);
  }

  double step_ = 0, fraction_ = 0;
  Eigen::Index last_, sample_ = 0;
  Eigen::VectorXd time_s_;
};

}  // namespace tendril::sim
