// One motor with its gear, spool, tendon and guide pulleys: from torque and motion to tensions and
// accelerations. Holds the hysteresis memories; knows nothing of the body, of solvers or of time beyond its
// torque loop. A copy continues independently from the original's state.
#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "tendon_laws.h"
#include "tendril/core/robot.h"
#include "tendril/model/capstan.h"
#include "tendril/model/stop_operator.h"
#include "torque_loop.h"

namespace tendril::sim {

/// Motion of one drivetrain. Positive pulls the tendon.
struct DrivetrainMotion {
  double angle_rad = 0;       // motor
  double velocity_radps = 0;  // motor
  double shortening_m = 0;    // d: straight tendon length of the straight robot less that of the bent one
  double shortening_rate_mps = 0;
};

/// Path of a coordinate since its memory was committed: straight to x, or via a turning point.
struct Way {
  double x = 0;
  bool turned = false;
  double turn = 0;
};

/// From x0 with velocity v0 to x with velocity v in h seconds.
Way WayTo(double x0, double v0, double x, double v, double h) noexcept;

/// Base tension for a motor-side tension, by the pulleys' sliding state z.
struct PulleyMap {
  double middle_N = 0, half_N = 0;
  double At(double z) const noexcept { return std::max(0.0, middle_N - z * half_N); }
};

/// Forces of a motion, with the friction memories as last committed.
struct DrivetrainForces {
  double torque_Nm = 0;  // at the motor shaft
  double tension_motor_N = 0;
  double tension_base_N = 0;
  double sliding = 0;      // z of the pulley
  double dahl = 0;         // zeta of the motor
  double gear_factor = 1;  // efficiency^(-+z_g): load torque at the motor over the lossless one
  double acceleration_radps2 = 0;
  double pull_N = 0;  // F and its inverse at the motor-side tension
  double release_N = 0;
  double spool_pull_m = 0;    // s
  double spool_rate_mps = 0;  // ds/dt
  double pull_m_per_rad = 0;  // ds/d(angle): 0 within the play
  double load_arm_m = 0;      // motor torque per tension without the gear's losses
  ShaftTorque extra;          // of the shaft laws
  Way slide, shaft;
};

/// Play between motor shaft and spool: position of the driven side, for a pull flank at 0.
class Play {
 public:
  explicit Play(double play) : play_(play) {}
  double Peek(double x) const noexcept { return std::clamp(at_, x, x + play_); }
  void Commit(double x) noexcept { at_ = Peek(x); }
  double play() const noexcept { return play_; }

 private:
  double play_, at_ = 0;
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
  /// Starts straight, at rest, with `start_tension_N` in the tendon and the torque that holds it.
  Drivetrain(const TendonDriveParameters& parameters, double start_tension_N,
             std::shared_ptr<const model::CapstanTable> capstan, const TendonLaws& laws = {});

  /// Sets the torque sent to the drive from now on.
  void SetTorque(double time_s, double sent_Nm) { loop_.Set(time_s, sent_Nm); }
  /// Reported torque, without noise: current times the nominal torque constant.
  double Torque(double time_s) const noexcept { return loop_.At(time_s); }
  const TorqueLoop& loop() const noexcept { return loop_; }
  /// The motor has pulled with this torque for long [N·m], instead of the one that holds the start tension.
  void StartWithTorque(double torque_Nm) { loop_ = loop_.Holding(torque_Nm); }
  /// See TorqueLoop.
  double NextCorner(double time_s) const noexcept { return loop_.NextCorner(time_s); }

  /// Forces at a motion reached at time_s, at or after the last commit. `opposing_Nm`: load torque, without
  /// the gear's losses, of another tendon that the same spool pays out; that tendon's own motor does not
  /// count.
  DrivetrainForces Evaluate(double time_s, const DrivetrainMotion& motion,
                            double opposing_Nm = 0) const noexcept;
  /// Linearised at the motion just evaluated.
  DrivetrainLinear Linearise(const DrivetrainMotion& motion, const DrivetrainForces& forces,
                             double gamma_s) const noexcept;
  /// Moves the hysteresis memories to a motion reached at time_s, via the turning points in between.
  void Commit(double time_s, const DrivetrainMotion& motion) noexcept;

  // Separate parts of the chain, along a measured motion. As for Evaluate, time_s is at or after the last
  // commit, and Commit advances; steps must be short enough to resolve a reversal.

  /// Motor-side tension [N], >= 0, for which the rotor has this acceleration under a torque as reported by
  /// the drive: (scale * torque - friction - inertia * acceleration) / (arm * gear factor).
  double TensionFromTorque(double time_s, const DrivetrainMotion& motion, double torque_Nm,
                           double acceleration_radps2) const noexcept;
  /// Motor-side tension [N], >= 0, of the tendon's spring and damper.
  double TensionFromStretch(double time_s, const DrivetrainMotion& motion) const noexcept;
  /// Robot-side tension [N] for a motor-side one, by the pulleys at the motion's sliding state.
  double BaseTension(double time_s, const DrivetrainMotion& motion, double tension_motor_N) const noexcept;

  /// At a motor-side tension >= 0.
  PulleyMap Pulleys(double tension_motor_N) const noexcept;

  /// Spool: s, ds/dt, ds/d(angle) (0 while the shaft crosses its play) and lever of the tendon at the motor.
  struct Spool {
    double pull_m, rate_mps, per_rad_m, arm_m;
  };
  Spool SpoolOf(double time_s, const DrivetrainMotion& motion) const noexcept {
    return SpoolAt(ShaftWay(time_s, motion), motion);
  }
  /// Neither play nor growth: SpoolOf is independent of the memories.
  bool plain_spool() const noexcept { return plain_spool_; }

  double rotor_inertia_kgm2() const noexcept { return inertia_; }
  double travel_m_per_rad() const noexcept { return travel_; }
  double stiffness_Npm() const noexcept { return stiffness_; }
  double damping_Nspm() const noexcept { return damping_; }

 private:
  Way ShaftWay(double time_s, const DrivetrainMotion& motion) const noexcept;
  Spool SpoolAt(const Way& shaft, const DrivetrainMotion& motion) const noexcept;
  Way SlideWay(double time_s, const DrivetrainMotion& motion, const Spool& spool) const noexcept;
  double Stretched(double time_s, const DrivetrainMotion& motion, const Spool& spool) const noexcept;
  double Base(double tension_motor_N, double sliding, double release_N, double pull_N) const noexcept;
  double Gear(const Way& way) const noexcept;
  /// Torque of friction and of the shaft laws against the rotor; stores zeta and the laws' part in `forces`.
  double Resistance(const DrivetrainMotion& motion, DrivetrainForces& forces) const noexcept;

  double travel_, stiffness_, damping_, stretch0_m_;
  double inertia_, coulomb_, dahl_angle_, dahl_damping_, viscous_, torque_scale_;
  double log_efficiency_;
  double pulley_coulomb_N_, low_tension_N_;
  double slide_step_m_, gear_step_rad_;  // steps of finite differences: small compared with every yield
  std::shared_ptr<const model::CapstanTable> capstan_;
  model::StopOperators<4> pulley_;
  model::DahlState dahl_;
  std::vector<model::StopOperators<1>> gear_;
  TorqueLoop loop_;
  std::vector<std::shared_ptr<const ShaftLaw>> shaft_laws_;
  std::vector<OwnedStretch> stretch_laws_;
  double growth_per_rad_m_;  // growth of the pull per motor angle, per motor angle of the driven side
  bool plain_spool_;         // neither play nor growth
  Play play_;
  // State at the last commit.
  double time_s_ = 0, angle_ = 0, velocity_ = 0, slide_ = 0, slide_rate_ = 0;
};

}  // namespace tendril::sim
