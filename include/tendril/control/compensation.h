// Motor torque for a commanded base tension: compensates friction of the pulleys (improved Capstan law), gear
// and motor. The sliding direction comes from the commanded motion through the pulleys' pre-sliding, so that
// the torque is continuous at a reversal. One object per tendon. Knows nothing of the bus.
#pragma once

#include <utility>

#include "tendril/core/robot.h"
#include "tendril/core/status.h"
#include "tendril/model/pull_map.h"
#include "tendril/model/stop_operator.h"

namespace tendril::control {

class StateArchive;

/// What one motor pulls: a tendon, or a pair as one tendon whose tension is the first's less the second's and
/// whose path is shortened by (k_a d_a - k_b d_b) / (k_a + k_b). Tendons with equal pulleys may share a
/// table.
struct Pulled {
  double stiffness_Npm, rest_N;  // the latter of the straight robot at rest
  model::PullMap map;

  Pulled(const TendonDriveParameters& tendon, double rest_tension_N, model::PullMap::Table table)
      : stiffness_Npm(tendon.tendon.stiffness_Npm),
        rest_N(rest_tension_N),
        map(tendon.transmission, std::move(table)) {}
  Pulled(const model::TendonPairs::Pair& pair, const TendonDriveParameters& first,
         const TendonDriveParameters& second, model::PullMap::Table first_table,
         model::PullMap::Table second_table)
      : stiffness_Npm(first.tendon.stiffness_Npm + second.tendon.stiffness_Npm),
        rest_N(0),
        map(pair, first.transmission, std::move(first_table), second.transmission, std::move(second_table)) {}
};

class Compensation {
 public:
  Compensation(const TendonDriveParameters& drive, const LimitParameters& limits, bool capstan,
               Pulled pulled);

  struct Result {
    double sliding = 0;          // z_c in [-1, 1], +1: the motor pulls
    double tension_motor_N = 0;  // commanded, on the motor side of the pulleys; of a pair the pull
    double torque_Nm = 0;        // to be sent: current x torque constant, within the drive's current limit
    Status status = Status::kOk;
  };

  /// One cycle. Sliding follows the commanded spool pull: shortening of the tendon's path in the body plus
  /// tendon stretch. `moving` false keeps the sliding state, while tensions ramp without shape control.
  Result Step(double tension_base_N, double shortening_m, bool moving) noexcept;

  /// Resets the sliding direction; the next step starts from here.
  void Reset(double tension_base_N, double shortening_m) noexcept;

  void Archive(StateArchive& archive) noexcept;

  double max_torque_Nm() const noexcept { return max_torque_Nm_; }
  model::PullMap& map() noexcept { return pulled_.map; }

 private:
  double SpoolPull(double tension_base_N, double shortening_m) const noexcept {
    return shortening_m + (tension_base_N - pulled_.rest_N) / pulled_.stiffness_Npm;
  }

  Pulled pulled_;
  bool capstan_;
  double max_tension_motor_N_;
  double travel_m_, efficiency_, coulomb_Nm_, torque_scale_, max_torque_Nm_;
  model::StopOperators<4> presliding_;
};

}  // namespace tendril::control
