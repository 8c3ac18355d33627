// Sampled signals between their samples and without their noise. Knows nothing of sensors.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace tendril::gap {

/// Local polynomial of degree 4 through 2h+1 equally spaced points: weights for value, first and second
/// derivative (per sample) at the middle.
struct LocalPolynomial {
  explicit LocalPolynomial(int half_width);

  int half;
  Eigen::RowVectorXd value, first, second;
};

/// Linear between knots, constant outside.
class Interpolator {
 public:
  void Add(double t, double y) {
    t_.push_back(t);
    y_.push_back(y);
  }
  double operator()(double t) {
    if (t <= t_.front()) return y_.front();
    if (t >= t_.back()) return y_.back();
    while (t_[at_ + 1] < t) ++at_;
    while (t_[at_] > t) --at_;
    const double s = (t - t_[at_]) / (t_[at_ + 1] - t_[at_]);
    return y_[at_] + s * (y_[at_ + 1] - y_[at_]);
  }
  bool empty() const { return t_.empty(); }

 private:
  std::vector<double> t_, y_;
  std::size_t at_ = 0;
};

/// Removes white noise of rms `noise` from a signal that is smooth most of the time: each sample becomes the
/// mean over the widest window in which a straight line leaves no more than the noise, so rest is smoothed
/// strongly and fast changes are not. Without this, friction memories driven by noise would creep.
Eigen::VectorXd Denoised(const Eigen::VectorXd& signal, double noise);

}  // namespace tendril::gap
