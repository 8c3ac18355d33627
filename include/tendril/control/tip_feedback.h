// Slow integral feedback from an external tip tracker to a shift of the tip goal. Knows nothing of how the
// goal is reached.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

/// d(shift)/dt = error / time_constant, at most kMaxRate_mps, with the rate itself limited by
/// kMaxAcceleration_mps2. The error is the reference at the time of the measurement (stamp less delay) less
/// the measurement, within the plane in which the tip can be moved. Rejected are readings older than
/// max_age_s, readings farther than kMaxDisagreement of the robot's length from the tendons' estimate at that
/// time, and readings that stay bit-identical for long. Without a usable reading for max_age_s the shift is
/// held and kTrackerLost is returned. At a resting goal an error within the tracker's noise is not corrected
/// until it is kWake times that, because an integral against dry friction would hunt. When the shift's path
/// there exceeds kRestWay times the largest error, correction stops; kTipErrorLeft reports a remaining error
/// above kWake times the noise.
class TipFeedback {
 public:
  static constexpr double kMaxRate_mps = 0.02, kMaxAcceleration_mps2 = 0.2;
  // Shares of the robot's length. A shift beyond the first is no model error and is limited, with
  // kLimitedTipCorrection.
  static constexpr double kMaxShare = 0.2;
  static constexpr double kMaxDisagreement = 0.1;
  static constexpr double kWake = 3;
  static constexpr double kRestWay = 2;

  TipFeedback(const TrackerParameters& tracker, double length_m, double period_s);

  /// One cycle. `reference_W_m` is the goal for time `now_ns + ahead_ns`, `estimate_W_m` the tendons' present
  /// estimate of the tip; u and v span the plane of the tip's motion. `acts` false: shift and history are
  /// cleared. `at_limit`: tensions saturate, so the shift is held.
  Status Step(const TrackerSample& sample, TimeNs now_ns, TimeNs ahead_ns,
              const Eigen::Vector3d& reference_W_m, const Eigen::Vector3d& estimate_W_m,
              const Eigen::Vector3d& u, const Eigen::Vector3d& v, bool acts, bool at_limit = false) noexcept;

  const Eigen::Vector3d& shift_W_m() const noexcept { return shift_W_m_; }
  double max_age_s() const noexcept { return max_age_s_; }
  double time_constant_s() const noexcept { return time_constant_s_; }
  void Archive(StateArchive& archive) noexcept;

 private:
  bool Plausible(const TrackerSample& sample, double age_s) noexcept;
  Eigen::Vector3d Before(const std::vector<Eigen::Vector3d>& ring, double cycles) const noexcept;

  double period_s_, time_constant_s_, reading_every_s_, delay_s_, max_age_s_, max_shift_m_,
      max_disagreement_m_, rest_band_m_, error_share_;
  std::int32_t most_same_;                             // identical readings in a row; 0: any number
  std::vector<Eigen::Vector3d> reference_, estimate_;  // of the last cycles, ring buffers
  std::int32_t next_ = 0, filled_ = 0;
  std::int64_t silent_cycles_ = 0, last_ns_ = 0;
  std::int32_t resting_cycles_ = 0, same_ = 0;
  bool asleep_ = false;
  double way_m_ = 0, largest_m_ = 0;  // since the goal is at rest: path of the shift, largest error
  Eigen::Vector3d shift_W_m_{0, 0, 0}, rate_W_mps_{0, 0, 0}, target_rate_W_mps_{0, 0, 0};
  Eigen::Vector3d error_W_m_{0, 0, 0}, last_tip_W_m_{0, 0, 0};  // low-passed error; tip of the last reading
};

}  // namespace tendril::control
