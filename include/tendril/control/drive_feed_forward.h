// Feed-forward torque for a commanded base tension and path shortening, from the laws of motor, gear and
// pulleys with their memory of the commanded motion. The torque is continuous at a reversal and constant at
// rest. One object per tendon. Knows nothing of the bus.
#pragma once

#include <memory>
#include <vector>

#include "tendril/control/compensation.h"
#include "tendril/core/robot.h"
#include "tendril/model/capstan.h"
#include "tendril/model/stop_operator.h"

namespace tendril::control {

class StateArchive;

/// With d the reference shortening, s the spool's pull and T0 the minimum tension at which both are zero:
///   s = d + (T_m - T0) / k,   x = (s + d) / 2,   T_b = (1 + z)/2 F^-1(T_m) + (1 - z)/2 F(T_m) - z T_c,
/// with z the pulleys' pre-sliding at x, solved for T_m; motor angle a = s / travel, its rates those of d;
///   torque = J a'' + T_m travel + loss + viscous a',
///   loss = T_m travel (efficiency^(-z_g) - 1) + coulomb zeta + micro-damping zeta',
/// z_g the gear's pre-sliding and zeta Dahl's state at a. Where a reversal would change the loss within a few
/// cycles, its rate is limited. Without `capstan` the pulleys transmit tension without loss.
class DriveFeedForward {
 public:
  DriveFeedForward(const TendonDriveParameters& drive, const LimitParameters& limits, bool capstan,
                   Pulled pulled, double period_s);

  struct Result : Compensation::Result {
    double motor_velocity_radps = 0;  // of the reference
    double rotor_N = 0;               // tension that accelerates the rotor
    double unloaded_Nm = 0;           // part of torque_Nm for the rotor's motion, without tension
    double load_torque_per_N = 0;     // torque at the motor per motor-side tension, in the present direction
  };

  /// One cycle. `arc_m` is the shortening of the reference arcs, from whose second derivative a'' is taken;
  /// that of d jumps with the reference acceleration, which bends the units as weight does. `moving` false:
  /// without shape control tensions change and the friction memories stay.
  Result Step(double tension_base_N, double shortening_m, double arc_m, bool moving) noexcept;

  /// Resets the directions; the next step starts from here, at rest.
  void Reset(double tension_base_N, double shortening_m) noexcept;

  model::PullMap& map() noexcept { return pulled_.map; }

  void Archive(StateArchive& archive) noexcept;

 private:
  double MotorTension(double tension_base_N, double shortening_m, double most_N, bool moving) const noexcept;

  Pulled pulled_;
  bool capstan_;
  double period_s_, max_tension_motor_N_, travel_m_, efficiency_, inertia_kgm2_, coulomb_Nm_,
      coulomb_angle_rad_, coulomb_damping_Nms_, viscous_Nms_, torque_scale_, max_torque_Nm_, loss_step_Nm_,
      reversal_rad_;
  model::StopOperators<4> pulleys_;
  std::vector<model::StopOperators<1>> gear_;
  model::DahlState dahl_;
  double shortening_m_ = 0, tension_base_N_ = 0, arc_m_ = 0, arc_rate_mps_ = 0;  // of the last step
  double friction_N_ = 0;  // motor tension less base tension
  double loss_Nm_ = 0;     // torque of gear and motor friction
  bool still_ = true;      // no previous step to take rates from
};

}  // namespace tendril::control
