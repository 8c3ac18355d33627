// From a wanted tension at the robot's base to a motor torque: friction of the pulleys (improved Capstan
// law), of the gear and of the motor, with the sliding direction taken from the wanted motion through the
// pulleys' pre-sliding, so that nothing jumps at a reversal. One object a tendon. Knows nothing of the bus.
#pragma once

#include <memory>

#include "tendril/core/robot.h"
#include "tendril/core/status.h"
#include "tendril/model/capstan.h"
#include "tendril/model/stop_operator.h"

namespace tendril::control {

class StateArchive;

class Compensation {
 public:
  /// `table` maps base to motor tension and may be shared by tendons with the same transmission.
  Compensation(const TendonDriveParameters& drive, const LimitParameters& limits, bool capstan,
               std::shared_ptr<const model::CapstanTable> table);

  struct Result {
    double sliding = 0;          // z_c in [-1, 1], +1: the motor pulls
    double tension_motor_N = 0;  // wanted on the motor's side of the pulleys
    double torque_Nm = 0;        // to be sent: current x torque constant, within the drive's current limit
    Status status = Status::kOk;
  };

  /// One cycle. Sliding follows the wanted spool pull: shortening of the tendon's path in the body plus the
  /// tendon's stretch. `moving` false keeps the sliding state (tensions ramp while the shape is not
  /// controlled).
  Result Step(double tension_base_N, double shortening_m, bool moving) noexcept;

  /// Forgets the direction of sliding; the next step starts from here.
  void Reset(double tension_base_N, double shortening_m) noexcept;

  void Remember(StateArchive& archive) noexcept;

  double max_torque_Nm() const noexcept { return max_torque_Nm_; }

 private:
  double SpoolPull(double tension_base_N, double shortening_m) const noexcept {
    return shortening_m + (tension_base_N - min_tension_N_) / stiffness_Npm_;
  }

  std::shared_ptr<const model::CapstanTable> table_;
  bool capstan_;
  double stiffness_Npm_, min_tension_N_, max_tension_motor_N_;
  double travel_m_, efficiency_, coulomb_Nm_, pulley_coulomb_N_, torque_scale_, max_torque_Nm_;
  model::StopOperators<4> presliding_;
};

}  // namespace tendril::control
