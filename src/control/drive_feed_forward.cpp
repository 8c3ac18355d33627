#include "tendril/control/drive_feed_forward.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "state_archive.h"

namespace tendril::control {
namespace {

constexpr int kMaxIterations = 30;
constexpr double kSolved_N = 1e-6;
constexpr double kFrictionRate_Nps = 15;  // at rest; the first tendon mode swings by a tenth of a newton then
constexpr double kSlow_mps = 1e-3;

}  // namespace

DriveFeedForward::DriveFeedForward(const TendonDriveParameters& drive, const LimitParameters& limits,
                                   bool capstan, std::shared_ptr<const model::CapstanTable> table,
                                   double period_s)
    : table_(std::move(table)),
      capstan_(capstan),
      period_s_(period_s),
      stiffness_Npm_(drive.tendon.stiffness_Npm),
      min_tension_N_(limits.min_tension_N),
      max_tension_motor_N_(limits.max_tension_motor_N),
      travel_m_(drive.SpoolTravelPerMotorRad()),
      efficiency_(drive.gear.efficiency),
      inertia_kgm2_(drive.motor.rotor_inertia_kgm2),
      coulomb_Nm_(drive.motor.coulomb_friction_Nm),
      coulomb_angle_rad_(drive.motor.coulomb_angle_rad),
      coulomb_damping_Nms_(drive.motor.coulomb_damping_Nms),
      viscous_Nms_(drive.motor.viscous_friction_Nms),
      pulley_coulomb_N_(drive.transmission.coulomb_N),
      torque_scale_(drive.motor.torque_scale),
      max_torque_Nm_(drive.motor.torque_constant_NmpA * drive.drive.current_limit_A),
      pulleys_(model::PulleyPresliding(drive.transmission.presliding_m)),
      dahl_(drive.motor.coulomb_angle_rad) {
  for (const double yield : drive.gear.presliding_yields_rad) gear_.emplace_back(std::array{yield});
}

void DriveFeedForward::Reset(double tension_base_N, double shortening_m) noexcept {
  const double pull_m = shortening_m + (tension_base_N - min_tension_N_) / stiffness_Npm_;
  pulleys_.Reset(0.5 * (pull_m + shortening_m));
  for (auto& g : gear_) g.Reset(pull_m / travel_m_);
  dahl_.Reset(pull_m / travel_m_);
  friction_N_ = MotorTension(tension_base_N, shortening_m, true) - tension_base_N;
  still_ = true;
}

double DriveFeedForward::BaseTension(double tension_motor_N, double sliding) const noexcept {
  return table_->MotorToBase(tension_motor_N, sliding) - pulley_coulomb_N_ * sliding;
}

// The pre-sliding that a motor tension meets depends on how far it stretches the tendon, so T_m is solved
// for: bracketed between paying out and pulling, secant steps that keep the bracket.
double DriveFeedForward::MotorTension(double tension_base_N, double shortening_m,
                                      bool moving) const noexcept {
  if (!capstan_) return tension_base_N;
  const auto missing_N = [&](double tension_motor_N) {
    const double slide_m = shortening_m + 0.5 * (tension_motor_N - min_tension_N_) / stiffness_Npm_;
    const double z = moving ? pulleys_.Peek(slide_m) : model::StopOperators<4>(pulleys_).Hold(slide_m);
    return BaseTension(tension_motor_N, z) - tension_base_N;
  };
  double low_N = table_->Release(std::max(0.0, tension_base_N - pulley_coulomb_N_));
  double high_N = table_->Pull(tension_base_N + pulley_coulomb_N_);
  double at_low = missing_N(low_N), at_high = missing_N(high_N);
  if (!(at_low < 0)) return low_N;
  if (!(at_high > 0)) return high_N;
  int side = 0;
  double tension_N = high_N;
  for (int i = 0; i < kMaxIterations && high_N - low_N > kSolved_N; ++i) {
    tension_N = (low_N * at_high - high_N * at_low) / (at_high - at_low);
    const double at = missing_N(tension_N);
    if (std::abs(at) <= kSolved_N) break;
    // Illinois: an end that stays counts half, so that both ends come in.
    if (at < 0) {
      low_N = tension_N;
      at_low = at;
      if (side == -1) at_high *= 0.5;
      side = -1;
    } else {
      high_N = tension_N;
      at_high = at;
      if (side == 1) at_low *= 0.5;
      side = 1;
    }
  }
  return tension_N;
}

DriveFeedForward::Result DriveFeedForward::Step(double tension_base_N, double shortening_m,
                                                bool moving) noexcept {
  Result r;
  const double solved_N = MotorTension(tension_base_N, shortening_m, moving) - tension_base_N;
  // Where a stretched tendon turns round under high tension its path has a fold: the friction that goes pulls
  // the spool farther than the pre-sliding is long, and the solution jumps. The motor is led across, the
  // faster the faster the tendon moves anyway.
  const double moved_m = moving && !still_ ? std::abs(shortening_m - shortening_m_) : 0;
  const double fast = moved_m / (moved_m + kSlow_mps * period_s_);
  const double most_N = kFrictionRate_Nps * period_s_ + fast * stiffness_Npm_ * moved_m;
  friction_N_ =
      still_ && !moving ? solved_N : friction_N_ + std::clamp(solved_N - friction_N_, -most_N, most_N);
  r.tension_motor_N = std::max(0.0, tension_base_N + friction_N_);
  if (r.tension_motor_N > max_tension_motor_N_) {
    r.tension_motor_N = max_tension_motor_N_;
    r.status = Status::kLimitedMotorTension;
  }
  const double pull_m = shortening_m + (r.tension_motor_N - min_tension_N_) / stiffness_Npm_;
  const double angle_rad = pull_m / travel_m_;
  double rate_mps = 0, acceleration_mps2 = 0, zeta = 0, gear = 0;
  if (moving) {
    if (!still_) rate_mps = (shortening_m - shortening_m_) / period_s_;
    if (!still_) acceleration_mps2 = (rate_mps - rate_mps_) / period_s_;
    r.sliding = pulleys_.Commit(0.5 * (pull_m + shortening_m));
    zeta = dahl_.Commit(angle_rad);
    for (auto& g : gear_) gear += g.Commit(angle_rad);
  } else {
    r.sliding = pulleys_.Hold(0.5 * (pull_m + shortening_m));
    zeta = dahl_.Hold(angle_rad);
    for (auto& g : gear_) gear += g.Hold(angle_rad);
  }
  if (!gear_.empty()) gear /= static_cast<double>(gear_.size());
  still_ = !moving;
  shortening_m_ = shortening_m;
  rate_mps_ = rate_mps;

  r.motor_velocity_radps = rate_mps / travel_m_;
  r.load_torque_per_N = travel_m_ * std::pow(efficiency_, -gear);
  const double zeta_rate =
      (r.motor_velocity_radps - std::abs(r.motor_velocity_radps) * zeta) / coulomb_angle_rad_;
  r.torque_Nm = inertia_kgm2_ * acceleration_mps2 / travel_m_ + r.tension_motor_N * r.load_torque_per_N +
                coulomb_Nm_ * zeta + coulomb_damping_Nms_ * zeta_rate + viscous_Nms_ * r.motor_velocity_radps;
  r.torque_Nm /= torque_scale_;  // the drive counts in current
  if (std::abs(r.torque_Nm) > max_torque_Nm_) {
    r.torque_Nm = std::copysign(max_torque_Nm_, r.torque_Nm);
    r.status = Status::kLimitedTorque;
  }
  return r;
}

void DriveFeedForward::Remember(StateArchive& a) noexcept {
  a.Operators(pulleys_);
  for (auto& g : gear_) a.Operators(g);
  a.Dahl(dahl_);
  a.Value(shortening_m_);
  a.Value(rate_mps_);
  a.Value(friction_N_);
  a.Value(still_);
}

}  // namespace tendril::control
