#include "begins_in_motion.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "tendril/sim/yardstick.h"

namespace tendril::sim {

using Eigen::Index;
using Eigen::VectorXd;

bool BeginsInMotion(const ReplaySignals& s, const RobotParameters& robot) {
  // Angles and tension hold for the reference rig: shares of a motor's travel and of the largest tension.
  constexpr double kLook_s = 0.3, kMean_s = 0.004, kAngle_rad = 0.02, kTurned_rad = 0.2, kTension_N = 0.04,
                   kNoise = 6;
  const double travel = OverReference(Yardstick::kMotorTravel, robot).bound;
  const double pull = OverReference(Yardstick::kTension, robot).bound;
  const auto moves = [&](const Eigen::MatrixXd& signal, double least) {
    const auto mean = std::max<Index>(1, std::lround(kMean_s / s.step_s));
    const Index windows = std::min(signal.rows(), static_cast<Index>(kLook_s / s.step_s)) / mean;
    for (Index j = 0; j < signal.cols() && windows > 2; ++j) {
      VectorXd value(windows), jump(windows - 1);
      for (Index w = 0; w < windows; ++w) value[w] = signal.col(j).segment(w * mean, mean).mean();
      if (!value.allFinite()) continue;
      jump = (value.tail(windows - 1) - value.head(windows - 1)).cwiseAbs();
      const auto middle = jump.data() + jump.size() / 2;
      std::nth_element(jump.data(), middle, jump.data() + jump.size());
      if (value.maxCoeff() - value.minCoeff() > least + kNoise * *middle) return true;
    }
    return false;
  };
  // A log that begins during a motion is neither: its motors have turned already.
  if (s.motor_angle_rad.size() > 0 && s.motor_angle_rad.row(0).cwiseAbs().maxCoeff() > kTurned_rad * travel)
    return false;
  return moves(s.motor_angle_rad, kAngle_rad * travel) || moves(s.tension_N, kTension_N * pull);
}

}  // namespace tendril::sim
