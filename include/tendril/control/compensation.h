// Motor torque for a commanded base tension: compensates friction of the pulleys (improved Capstan law), gear
// and motor. The sliding direction comes from the commanded motion through the pulleys' pre-sliding, so that
// the torque is continuous at a reversal. One object per tendon. Knows nothing of the bus.
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
  /// `table` maps base to motor tension; tendons with the same transmission may share it.
  Compensation(const TendonDriveParameters& drive, const LimitParameters& limits, bool capstan,
               std::shared_ptr<const model::CapstanTable> table);

  struct Result {
    double sliding = 0;          // z_c in [-1, 1], +1: the motor pulls
    double tension_motor_N = 0;  // commanded, on the motor side of the pulleys
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
