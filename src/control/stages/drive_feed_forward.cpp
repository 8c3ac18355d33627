#include "tendril/control/drive_feed_forward.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/control/state_archive.h"
#include "tendril/model/bracketed_root.h"

namespace tendril::control {
namespace {

constexpr int kMaxIterations = 30;
constexpr double kSolved_N = 1e-6;
// Limit of the change of friction, relative to the tension change that the commanded pull would cause at a
// fixed spool; in slow motion and, beyond kSlow_mps, in proportion to the motion. A reversal completes within
// a period or two of the tendon's oscillation (about 12 Hz), which it hardly excites.
constexpr double kFrictionPerPull = 12;
constexpr double kFrictionRate_Nps = 25;
constexpr double kSlow_mps = 3e-4;
// Rate limit of gear and motor losses per cycle, as a share of the drive's rated torque: a sixth of the
// motor's dry friction. In fast motion the limit grows by up to the second factor.
constexpr double kLossStep = 0.005, kFastestLoss = 7;

}  // namespace

DriveFeedForward::DriveFeedForward(const TendonDriveParameters& drive, const LimitParameters& limits,
                                   bool capstan, Pulled pulled, double period_s)
    : pulled_(std::move(pulled)),
      capstan_(capstan),
      period_s_(period_s),
      max_tension_motor_N_(limits.max_tension_motor_N),
      travel_m_(drive.SpoolTravelPerMotorRad()),
      efficiency_(drive.gear.efficiency),
      inertia_kgm2_(drive.motor.rotor_inertia_kgm2),
      coulomb_Nm_(drive.motor.coulomb_friction_Nm),
      coulomb_angle_rad_(drive.motor.coulomb_angle_rad),
      coulomb_damping_Nms_(drive.motor.coulomb_damping_Nms),
      viscous_Nms_(drive.motor.viscous_friction_Nms),
      torque_scale_(drive.motor.torque_scale),
      max_torque_Nm_(drive.motor.torque_constant_NmpA * drive.drive.current_limit_A),
      loss_step_Nm_(kLossStep * drive.drive.rated_torque_Nm),
      reversal_rad_(2 * drive.motor.coulomb_angle_rad),
      pulleys_(model::PulleyPresliding(drive.transmission.presliding_m)),
      dahl_(drive.motor.coulomb_angle_rad) {
  for (const double yield : drive.gear.presliding_yields_rad) {
    gear_.emplace_back(std::array{yield});
    reversal_rad_ = std::max(reversal_rad_, 2 * yield);
  }
}

void DriveFeedForward::Reset(double tension_base_N, double shortening_m) noexcept {
  const double pull_m = shortening_m + (tension_base_N - pulled_.rest_N) / pulled_.stiffness_Npm;
  pulleys_.Reset(0.5 * (pull_m + shortening_m));
  for (auto& g : gear_) g.Reset(pull_m / travel_m_);
  dahl_.Reset(pull_m / travel_m_);
  friction_N_ = MotorTension(tension_base_N, shortening_m, max_tension_motor_N_, true) - tension_base_N;
  loss_Nm_ = 0;
  shortening_m_ = shortening_m;
  tension_base_N_ = tension_base_N;
  still_ = true;
}

// The pre-sliding at a motor tension depends on how far that tension stretches the tendon, so T_m is found by
// bracketed secant steps between the last tension and `most_N` from it, or as near to the solution as this
// range allows. Where a stretched tendon reverses under high tension the path has a fold: the released
// friction pulls the spool farther than the pre-sliding distance, and there are three solutions. The nearest
// one is followed until it ends; then the tension moves to the next at a limited rate.
double DriveFeedForward::MotorTension(double tension_base_N, double shortening_m, double most_N,
                                      bool moving) const noexcept {
  if (!capstan_) return tension_base_N;
  const auto missing_N = [&](double tension_motor_N) {
    const double slide_m = shortening_m + 0.5 * (tension_motor_N - pulled_.rest_N) / pulled_.stiffness_Npm;
    const double z = moving ? pulleys_.Peek(slide_m) : model::StopOperators<4>(pulleys_).Hold(slide_m);
    return pulled_.map.MotorToBase(tension_motor_N, z) - tension_base_N;
  };
  const double paid_out_N = pulled_.map.LeastAtMotor(tension_base_N);
  const double pulled_N = pulled_.map.MostAtMotor(tension_base_N);
  const double near_N = std::clamp(tension_base_N + friction_N_, paid_out_N, pulled_N);
  const double at_near = missing_N(near_N);
  if (std::abs(at_near) <= kSolved_N) return near_N;
  const double far_N =
      at_near < 0 ? std::min(near_N + most_N, pulled_N) : std::max(near_N - most_N, paid_out_N);
  const double at_far = missing_N(far_N);
  if (at_near * at_far >= 0) return far_N;
  return model::BracketedRoot(missing_N, near_N, at_near, far_N, at_far, kSolved_N, kMaxIterations);
}

DriveFeedForward::Result DriveFeedForward::Step(double tension_base_N, double shortening_m, double arc_m,
                                                bool moving) noexcept {
  Result r;
  // Across the fold the change of friction is limited by the commanded motion, so that it rests when the
  // command rests: a tendon stopped under high tension must not reverse at a micrometre of motion. While the
  // shape is not controlled there is no limit. A robot that resumes from such a fold changes no faster than
  // one that never stopped.
  const double moved_m = still_ ? 0 : std::abs(shortening_m - shortening_m_);
  const double pulled_N = pulled_.stiffness_Npm * moved_m + std::abs(tension_base_N - tension_base_N_);
  const double fast = moved_m / (moved_m + kSlow_mps * period_s_);
  const double most_N = moving
                            ? std::min(kFrictionPerPull * pulled_N,
                                       kFrictionRate_Nps * period_s_ + fast * pulled_.stiffness_Npm * moved_m)
                            : max_tension_motor_N_;
  friction_N_ = MotorTension(tension_base_N, shortening_m, most_N, moving) - tension_base_N;
  r.tension_motor_N = tension_base_N + friction_N_;
  if (!pulled_.map.is_pair()) r.tension_motor_N = std::max(0.0, r.tension_motor_N);
  if (const double within_N = pulled_.map.Within(r.tension_motor_N, max_tension_motor_N_);
      within_N != r.tension_motor_N) {
    r.tension_motor_N = within_N;
    r.status = Status::kLimitedMotorTension;
  }
  const double pull_m = shortening_m + (r.tension_motor_N - pulled_.rest_N) / pulled_.stiffness_Npm;
  const double angle_rad = pull_m / travel_m_;
  double rate_mps = 0, acceleration_mps2 = 0, zeta = 0, gear = 0;
  if (moving) {
    if (!still_) rate_mps = (shortening_m - shortening_m_) / period_s_;
    const double arc_rate_mps = still_ ? 0 : (arc_m - arc_m_) / period_s_;
    if (!still_) acceleration_mps2 = (arc_rate_mps - arc_rate_mps_) / period_s_;
    arc_rate_mps_ = arc_rate_mps;
    r.sliding = pulleys_.Commit(0.5 * (pull_m + shortening_m));
    zeta = dahl_.Commit(angle_rad);
    for (auto& g : gear_) gear += g.Commit(angle_rad);
  } else {
    r.sliding = pulleys_.Hold(0.5 * (pull_m + shortening_m));
    zeta = dahl_.Hold(angle_rad);
    for (auto& g : gear_) gear += g.Hold(angle_rad);
  }
  if (!gear_.empty()) gear /= static_cast<double>(gear_.size());
  const bool fresh = still_ && !moving;
  still_ = !moving;
  shortening_m_ = shortening_m;
  tension_base_N_ = tension_base_N;
  arc_m_ = arc_m;
  if (!moving) arc_rate_mps_ = 0;

  r.motor_velocity_radps = rate_mps / travel_m_;
  r.load_torque_per_N = travel_m_ * std::pow(efficiency_, r.tension_motor_N < 0 ? gear : -gear);
  const double zeta_rate =
      (r.motor_velocity_radps - std::abs(r.motor_velocity_radps) * zeta) / coulomb_angle_rad_;
  const double loss_Nm = r.tension_motor_N * (r.load_torque_per_N - travel_m_) + coulomb_Nm_ * zeta +
                         coulomb_damping_Nms_ * zeta_rate;
  // The loss that a reversal changes, spread over the motor angle of the reversal: the limit for commanded
  // motion alone. Friction released by the pulleys also moves the motor through its pre-sliding within a few
  // cycles; a full change then would be a torque step.
  const double load_N = std::abs(r.tension_motor_N);
  const double turned_Nm = 2 * coulomb_Nm_ + load_N * travel_m_ * (1 / efficiency_ - efficiency_);
  const double most_Nm = std::clamp(turned_Nm * std::abs(r.motor_velocity_radps) * period_s_ / reversal_rad_,
                                    loss_step_Nm_, kFastestLoss * loss_step_Nm_);
  loss_Nm_ = fresh ? loss_Nm : loss_Nm_ + std::clamp(loss_Nm - loss_Nm_, -most_Nm, most_Nm);
  r.rotor_N = inertia_kgm2_ * acceleration_mps2 / (travel_m_ * travel_m_);
  r.unloaded_Nm = r.rotor_N * travel_m_ + viscous_Nms_ * r.motor_velocity_radps;
  r.torque_Nm = r.unloaded_Nm + r.tension_motor_N * travel_m_ + loss_Nm_;
  r.torque_Nm /= torque_scale_;  // the drive's torque unit is nominal: current x torque constant
  r.unloaded_Nm /= torque_scale_;
  if (std::abs(r.torque_Nm) > max_torque_Nm_) {
    r.torque_Nm = std::copysign(max_torque_Nm_, r.torque_Nm);
    r.status = Status::kLimitedTorque;
  }
  return r;
}

void DriveFeedForward::Archive(StateArchive& a) noexcept {
  a.Operators(pulleys_);
  for (auto& g : gear_) a.Operators(g);
  a.Dahl(dahl_);
  a.Value(shortening_m_);
  a.Value(tension_base_N_);
  a.Value(arc_m_);
  a.Value(arc_rate_mps_);
  a.Value(loss_Nm_);
  a.Value(friction_N_);
  a.Value(still_);
}

}  // namespace tendril::control
