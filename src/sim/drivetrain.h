// One motor with its gear, spool, tendon and guide pulleys: from torque and motion to tensions and
// accelerations. Holds the hysteresis memories; knows nothing of the body, of solvers or of time beyond its
// torque loop.
#pragma once

#include <memory>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/model/capstan.h"
#include "tendril/model/stop_operator.h"

namespace tendril::sim {

/// Motion of one drivetrain. Positive pulls the tendon.
struct DrivetrainMotion {
  double angle_rad = 0;       // motor
  double velocity_radps = 0;  // motor
  double dahl = 0;            // zeta, the Coulomb friction's state in [-1, 1]
  double shortening_m = 0;    // d: straight tendon length of the straight robot less that of the bent one
  double shortening_rate_mps = 0;
};

/// What the motion does, friction memories standing where they were last committed.
struct DrivetrainForces {
  double tension_motor_N = 0;
  double tension_base_N = 0;
  double sliding = 0;      // z of the pulley
  double gear_factor = 1;  // efficiency^(-z_g): load torque at the motor over the lossless one
  double acceleration_radps2 = 0;
  double dahl_rate_ps = 0;
  double pull_N = 0;  // F and its inverse at the motor-side tension
  double release_N = 0;
};

/// One tendon in the equations linearised over a solver's step of weight gamma [s], as an implicit step needs
/// them. With B the row of shortening per bending, dv and dw the changes of bending rate and motor velocity:
///   change of base tension:  base_body * (-B dv) + base_motor * dw + (what known changes of positions add),
///   rotor:  inertia * dw + rotor_body * (-B dv) = (what known changes add).
struct DrivetrainLinear {
  double base_body = 0, base_motor = 0;  // N per m/s, N per rad/s
  double rotor_body = 0, inertia = 0;    // as torque impulse over gamma; the Dahl state is eliminated

  /// Known changes of positions and of the Dahl state -> change of base tension [N], torque on the rotor
  /// [N·m].
  double BaseTension(double angle_change_rad, double shortening_change_m) const noexcept {
    return base_spring * (travel * angle_change_rad - shortening_change_m) +
           base_slide * (travel * angle_change_rad + shortening_change_m);
  }
  double RotorTorque(double angle_change_rad, double shortening_change_m, double dahl_change) const noexcept {
    return -rotor_spring * (travel * angle_change_rad - shortening_change_m) - rotor_gear * angle_change_rad -
           rotor_dahl * dahl_change / dahl_relax;
  }
  /// Change of the Dahl state that goes with a change of motor velocity.
  double DahlChange(double velocity_change_radps, double dahl_change) const noexcept {
    return (dahl_change + dahl_build * velocity_change_radps) / dahl_relax;
  }

  double travel = 0, base_spring = 0, base_slide = 0, rotor_spring = 0, rotor_gear = 0;
  double rotor_dahl = 0, dahl_relax = 1, dahl_build = 0;
};

class Drivetrain {
 public:
  /// Straight, at rest, `start_tension_N` in the tendon and the torque that holds it.
  Drivetrain(const TendonDriveParameters& parameters, double start_tension_N,
             std::shared_ptr<const model::CapstanTable> capstan);

  /// Torque loop: T' = (wanted - T) / lag, solved exactly, so that a solver sees no states or corners of it.
  void SetTorque(double time_s, double wanted_Nm) noexcept;
  double Torque(double time_s) const noexcept;

  DrivetrainForces Evaluate(const DrivetrainMotion& motion, double torque_Nm) const noexcept;

  /// Linearised at a motion just evaluated.
  DrivetrainLinear Linearise(const DrivetrainMotion& motion, const DrivetrainForces& forces,
                             double gamma_s) const noexcept;

  /// Moves the hysteresis memories along the way from the last committed motion, through the turning point if
  /// the direction changed during these step_s seconds.
  void Commit(const DrivetrainMotion& motion, double step_s) noexcept;

  double rotor_inertia_kgm2() const noexcept { return inertia_; }
  double travel_m_per_rad() const noexcept { return travel_; }
  double stiffness_Npm() const noexcept { return stiffness_; }
  double damping_Nspm() const noexcept { return damping_; }
  double coulomb_Nm() const noexcept { return coulomb_; }

 private:
  double Gear(double angle_rad) const noexcept;
  double SlidingSlope(double x_m) const noexcept;
  double GearSlope(double angle_rad) const noexcept;

  double travel_, stiffness_, damping_, stretch0_m_;
  double inertia_, coulomb_, dahl_angle_, dahl_damping_, viscous_, lag_s_;
  double log_efficiency_;
  double slide_step_m_, gear_step_rad_;  // of the slopes' differences: small beside every yield
  std::shared_ptr<const model::CapstanTable> capstan_;
  model::StopOperators<4> pulley_;
  std::vector<model::StopOperators<1>> gear_;
  // Where the memories stand, with the velocities there.
  double angle_ = 0, velocity_ = 0, slide_ = 0, slide_rate_ = 0;
  double torque_time_s_ = 0, torque_from_ = 0, torque_wanted_ = 0;
};

}  // namespace tendril::sim
