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
/// measured (its stamp less its delay), less what it measured, within the plane in which the tip can be
/// moved. The rate itself changes by at most kMaxAcceleration_mps2. Readings older than max_age_s are not
/// used, nor those that cannot be true: farther than kMaxDisagreement of the robot's length from where the
/// tendons say that the tip was, or the same to the last bit for long; without any usable one so long the
/// shift stays as it is and kTrackerLost says so. Where the goal rests and the error is within the tracker's
/// noise, the shift rests until the error is kWake times that: dry friction lets a tip stick, and an integral
/// that pulled at it would hunt; and it goes no longer a way there, to and fro, than kRestWay times the
/// largest error: more than kWake times the noise that is left then is kTipErrorLeft.
class TipFeedback {
 public:
  static constexpr double kMaxRate_mps = 0.02, kMaxAcceleration_mps2 = 0.2;
  // Of the robot's length: more is no error of a model, and kLimitedTipCorrection says that more was asked
  // for.
  static constexpr double kMaxShare = 0.2;
  static constexpr double kMaxDisagreement = 0.1;
  static constexpr double kWake = 3;
  static constexpr double kRestWay = 2;

  TipFeedback(const TrackerParameters& tracker, double length_m, double period_s);

  /// One cycle. `wanted_W_m` is the goal for time `now_ns + ahead_ns`, `estimate_W_m` where the tendons say
  /// that the tip is now; u and v span the plane of the tip's motion. `acts` false: the shift goes and what
  /// was wanted is forgotten. `at_limit`: tensions are, so that no shift changes anything; it stays.
  Status Step(const TrackerSample& sample, TimeNs now_ns, TimeNs ahead_ns, const Eigen::Vector3d& wanted_W_m,
              const Eigen::Vector3d& estimate_W_m, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
              bool acts, bool at_limit = false) noexcept;

  const Eigen::Vector3d& shift_W_m() const noexcept { return shift_W_m_; }
  double max_age_s() const noexcept { return max_age_s_; }
  double time_constant_s() const noexcept { return time_constant_s_; }
  void Remember(StateArchive& archive) noexcept;

 private:
  bool Plausible(const TrackerSample& sample, double age_s) noexcept;
  Eigen::Vector3d Before(const std::vector<Eigen::Vector3d>& ring, double cycles) const noexcept;

  double period_s_, time_constant_s_, reading_every_s_, delay_s_, max_age_s_, max_shift_m_,
      max_disagreement_m_, rest_band_m_, error_share_;
  std::int32_t most_same_;                          // readings in a row; 0: any number
  std::vector<Eigen::Vector3d> wanted_, estimate_;  // of the last cycles, rings
  std::int32_t next_ = 0, filled_ = 0;
  std::int64_t silent_cycles_ = 0, last_ns_ = 0;
  std::int32_t resting_cycles_ = 0, same_ = 0;
  bool asleep_ = false;
  double way_m_ = 0, largest_m_ = 0;  // since the goal rests: of the shift to and fro, and the error at most
  Eigen::Vector3d shift_W_m_{0, 0, 0}, rate_W_mps_{0, 0, 0}, wanted_rate_W_mps_{0, 0, 0};
  Eigen::Vector3d error_W_m_{0, 0, 0}, last_tip_W_m_{0, 0, 0};  // low-passed; of the last reading
};

}  // namespace tendril::control
