#include "tendril/control/compensation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/control/state_archive.h"

namespace tendril::control {

Compensation::Compensation(const TendonDriveParameters& drive, const LimitParameters& limits, bool capstan,
                           Pulled pulled)
    : pulled_(std::move(pulled)),
      capstan_(capstan),
      max_tension_motor_N_(limits.max_tension_motor_N),
      travel_m_(drive.SpoolTravelPerMotorRad()),
      efficiency_(drive.gear.efficiency),
      coulomb_Nm_(drive.motor.coulomb_friction_Nm),
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
  if (capstan_) r.tension_motor_N = pulled_.map.BaseToMotor(tension_base_N, r.sliding);
  if (const double within_N = pulled_.map.Within(r.tension_motor_N, max_tension_motor_N_);
      within_N != r.tension_motor_N) {
    r.tension_motor_N = within_N;
    r.status = Status::kLimitedMotorTension;
  }
  // Gear losses follow the direction of power, Coulomb friction opposes motion. Both use the pulley's smooth
  // sliding direction, so the torque is continuous through a reversal.
  const double gear = std::pow(efficiency_, r.tension_motor_N < 0 ? r.sliding : -r.sliding);
  r.torque_Nm = r.tension_motor_N * travel_m_ * gear + coulomb_Nm_ * r.sliding;
  r.torque_Nm /= torque_scale_;  // the drive's torque unit is nominal: current x torque constant
  if (std::abs(r.torque_Nm) > max_torque_Nm_) {
    r.torque_Nm = std::copysign(max_torque_Nm_, r.torque_Nm);
    r.status = Status::kLimitedTorque;
  }
  return r;
}

void Compensation::Archive(StateArchive& a) noexcept { a.Operators(presliding_); }

}  // namespace tendril::control
