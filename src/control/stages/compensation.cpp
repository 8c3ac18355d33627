#include "tendril/control/compensation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/control/state_archive.h"

namespace tendril::control {

Compensation::Compensation(const TendonDriveParameters& drive, const LimitParameters& limits, bool capstan,
                           std::shared_ptr<const model::CapstanTable> table)
    : table_(std::move(table)),
      capstan_(capstan),
      stiffness_Npm_(drive.tendon.stiffness_Npm),
      min_tension_N_(limits.min_tension_N),
      max_tension_motor_N_(limits.max_tension_motor_N),
      travel_m_(drive.SpoolTravelPerMotorRad()),
      efficiency_(drive.gear.efficiency),
      coulomb_Nm_(drive.motor.coulomb_friction_Nm),
      pulley_coulomb_N_(drive.transmission.coulomb_N),
      torque_scale_(drive.motor.torque_scale),
      max_torque_Nm_(drive.motor.torque_constant_NmpA * drive.drive.current_limit_A),
      presliding_(model::PulleyPresliding(drive.transmission.presliding_m)) {}

void Compensation::Reset(double tension_base_N, double shortening_m) noexcept {
  presliding_.Reset(SpoolPull(tension_base_N, shortening_m));
}

Compensation::Result Compensation::Step(double tension_base_N, double shortening_m, bool moving) noexcept {
  Result r;
  const double pull_m = SpoolPull(tension_base_N, shortening_m);
  if (moving) {
    r.sliding = presliding_.Commit(pull_m);
  } else {
    r.sliding = presliding_.Hold(pull_m);
  }
  r.tension_motor_N = tension_base_N;
  if (capstan_) {
    const double load_N = std::max(0.0, tension_base_N + pulley_coulomb_N_ * r.sliding);
    r.tension_motor_N = table_->BaseToMotor(load_N, r.sliding);
  }
  if (r.tension_motor_N > max_tension_motor_N_) {
    r.tension_motor_N = max_tension_motor_N_;
    r.status = Status::kLimitedMotorTension;
  }
  // Gear losses follow the direction of power, Coulomb friction opposes motion. Both use the pulley's smooth
  // sliding direction, so the torque is continuous through a reversal.
  r.torque_Nm = r.tension_motor_N * travel_m_ * std::pow(efficiency_, -r.sliding) + coulomb_Nm_ * r.sliding;
  r.torque_Nm /= torque_scale_;  // the drive's torque unit is nominal: current x torque constant
  if (std::abs(r.torque_Nm) > max_torque_Nm_) {
    r.torque_Nm = std::copysign(max_torque_Nm_, r.torque_Nm);
    r.status = Status::kLimitedTorque;
  }
  return r;
}

void Compensation::Archive(StateArchive& a) noexcept { a.Operators(presliding_); }

}  // namespace tendril::control
