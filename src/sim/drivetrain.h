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
  double shortening_m = 0;    // d: straight tendon length of the straight robot less that of the bent one
  double shortening_rate_mps = 0;
};

/// Way of a coordinate since its memory was committed: straight to x, or back from a turning point.
struct Way {
  double x = 0;
  bool turned = false;
  double turn = 0;
};

/// What the motion does, with the friction memories as they were committed last.
struct DrivetrainForces {
  double torque_Nm = 0;  // electromagnetic
  double tension_motor_N = 0;
  double tension_base_N = 0;
  double sliding = 0;      // z of the pulley
  double dahl = 0;         // zeta of the motor
  double gear_factor = 1;  // efficiency^(-z_g): load torque at the motor over the lossless one
  double acceleration_radps2 = 0;
  double pull_N = 0;  // F and its inverse at the motor-side tension
  double release_N = 0;
  Way slide, shaft;
};

/// One tendon in the equations linearised over a solver's step of weight gamma [s], as an implicit step needs
/// them. With B the row of shortening per bending, dv and dw the changes of bending rate and motor velocity:
///   gamma * change of base tension:  base_body * (-B dv) + base_motor * dw + (what known changes of
///   positions add), rotor:  inertia * dw + rotor_body * (-B dv) = (what known changes add).
struct DrivetrainLinear {
  double base_body = 0, base_motor = 0;
  double rotor_body = 0, inertia = 0;

  /// Known changes of positions -> change of base tension [N], torque on the rotor [N·m].
  double BaseTension(double angle_change_rad, double shortening_change_m) const noexcept {
    return base_spring * (travel * angle_change_rad - shortening_change_m) +
           base_slide * (travel * angle_change_rad + shortening_change_m);
  }
  double RotorTorque(double angle_change_rad, double shortening_change_m) const noexcept {
    return -rotor_spring * (travel * angle_change_rad - shortening_change_m) -
           rotor_friction * angle_change_rad;
  }

  double travel = 0, base_spring = 0, base_slide = 0, rotor_spring = 0, rotor_friction = 0;
};

class Drivetrain {
 public:
  /// Straight, at rest, `start_tension_N` in the tendon and the torque that holds it.
  Drivetrain(const TendonDriveParameters& parameters, double start_tension_N,
             std::shared_ptr<const model::CapstanTable> capstan);

  /// Torque loop: T' = (wanted - T) / lag, solved exactly, so that a solver sees no states or corners of it.
  void SetTorque(double time_s, double wanted_Nm) noexcept;
  double Torque(double time_s) const noexcept;

  /// Forces at a motion reached at time_s, at or after the last commit.
  DrivetrainForces Evaluate(double time_s, const DrivetrainMotion& motion) const noexcept;
  /// Linearised at a motion just evaluated.
  DrivetrainLinear Linearise(const DrivetrainMotion& motion, const DrivetrainForces& forces,
                             double gamma_s) const noexcept;
  /// Moves the hysteresis memories to a motion reached at time_s, through the turning points on the way.
  void Commit(double time_s, const DrivetrainMotion& motion) noexcept;

  double rotor_inertia_kgm2() const noexcept { return inertia_; }
  double travel_m_per_rad() const noexcept { return travel_; }
  double stiffness_Npm() const noexcept { return stiffness_; }
  double damping_Nspm() const noexcept { return damping_; }

 private:
  double Slide(const DrivetrainMotion& motion) const noexcept;
  double SlideRate(const DrivetrainMotion& motion) const noexcept;
  Way SlideWay(double time_s, const DrivetrainMotion& motion) const noexcept;
  Way ShaftWay(double time_s, const DrivetrainMotion& motion) const noexcept;
  double Gear(Way way) const noexcept;

  double travel_, stiffness_, damping_, stretch0_m_;
  double inertia_, coulomb_, dahl_angle_, dahl_damping_, viscous_, lag_s_;
  double log_efficiency_;
  double slide_step_m_, gear_step_rad_;  // of the slopes' differences: small beside every yield
  std::shared_ptr<const model::CapstanTable> capstan_;
  model::StopOperators<4> pulley_;
  model::DahlState dahl_;
  std::vector<model::StopOperators<1>> gear_;
  // Where and when the memories were committed.
  double time_s_ = 0, angle_ = 0, velocity_ = 0, slide_ = 0, slide_rate_ = 0;
  double torque_time_s_ = 0, torque_from_ = 0, torque_wanted_ = 0;
};

}  // namespace tendril::sim
