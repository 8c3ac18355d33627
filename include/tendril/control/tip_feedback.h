// What an outside tracker sees of the tip, integrated slowly into a shift of the tip's goal. Knows nothing of
// how the goal is reached.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

/// d(shift)/dt = error / time_constant, at most kMaxRate_mps; the error is what was wanted when the tracker
/// measured, less what it measured, within the plane in which the tip can be moved. Older samples than
/// max_age_s are not used; without any so long the shift stays as it is and kTrackerLost says so.
class TipFeedback {
 public:
  static constexpr double kMaxRate_mps = 0.02;
  // Of the robot's length: more is no error of a model, and kLimitedTipCorrection says that more was asked for.
  static constexpr double kMaxShare = 0.2;

  TipFeedback(const TrackerParameters& tracker, double length_m, double period_s);

  /// One cycle. `wanted_W_m` is the goal for time `now_ns + ahead_ns`; u and v span the plane of the tip's
  /// motion. `acts` false: the shift goes and what was wanted is forgotten.
  Status Step(const TrackerSample& sample, TimeNs now_ns, TimeNs ahead_ns, const Eigen::Vector3d& wanted_W_m,
              const Eigen::Vector3d& u, const Eigen::Vector3d& v, bool acts) noexcept;

  const Eigen::Vector3d& shift_W_m() const noexcept { return shift_W_m_; }
  double max_age_s() const noexcept { return max_age_s_; }
  void Remember(StateArchive& archive) noexcept;

 private:
  double period_s_, time_constant_s_, reading_every_s_, max_age_s_, max_shift_m_;
  std::vector<Eigen::Vector3d> wanted_;  // of the last cycles, a ring
  std::int32_t next_ = 0, filled_ = 0;
  std::int64_t silent_cycles_ = 0, last_ns_ = 0;
  Eigen::Vector3d shift_W_m_{0, 0, 0}, rate_W_mps_{0, 0, 0};
};

}  // namespace tendril::control
