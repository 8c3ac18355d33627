// Corners joined by straight lines, in time: what a program's targets are made of. Knows nothing of robots.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "allowance.h"

namespace tendril::experiment {

/// Corners joined by straight lines, in time.
class Track {
 public:
  explicit Track(const Eigen::VectorXd& start) : corners_{{0, start}} {}

  void Line(const Eigen::VectorXd& to, double seconds) { corners_.push_back({end_s() + seconds, to}); }
  void Hold(double seconds) { Line(corners_.back().second, seconds); }
  double end_s() const { return corners_.back().first; }
  const Eigen::VectorXd& end() const { return corners_.back().second; }

  Eigen::MatrixXd Sample(int rows) const {
    Eigen::MatrixXd m(rows, end().size());
    std::size_t next = 1;
    for (int i = 0; i < rows; ++i) {
      const double t = i * kStep_s;
      while (next + 1 < corners_.size() && corners_[next].first < t) ++next;
      const auto& [t0, a] = corners_[next - 1];
      const auto& [t1, b] = corners_[next];
      const double share = t1 > t0 ? std::clamp((t - t0) / (t1 - t0), 0.0, 1.0) : 1;
      m.row(i) = (a + share * (b - a)).transpose();
    }
    return m;
  }

 private:
  std::vector<std::pair<double, Eigen::VectorXd>> corners_;
};

/// From 0 to 1 without a jerk, as the share goes there.
inline double Smooth(double share) {
  return 0.5 * (1 - std::cos(std::numbers::pi * std::clamp(share, 0.0, 1.0)));
}

}  // namespace tendril::experiment
