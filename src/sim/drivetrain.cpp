// The drivetrain's laws: tendon spring, pulley friction with pre-sliding, Dahl motor friction, gear
// efficiency. Knows one tendon only.
#include "drivetrain.h"

#include <algorithm>
#include <cmath>

namespace tendril::sim {
namespace {

/// Extreme of a coordinate that went from x0 to x1 in h seconds with velocities v0 and v1 of opposite sign:
/// the cubic through both ends, at the zero of the straight line between the velocities (stationary there, so
/// the error is of second order in that time's).
double TurningPoint(double x0, double v0, double x1, double v1, double h) {
  const double s = v0 / (v0 - v1);
  const double r = 1 - s;
  const double x = r * r * (1 + 2 * s) * x0 + s * s * (3 - 2 * s) * x1 + h * s * r * (r * v0 - s * v1);
  return v0 > 0 ? std::max({x, x0, x1}) : std::min({x, x0, x1});
}

}  // namespace

Drivetrain::Drivetrain(const TendonDriveParameters& p, double start_tension_N,
                       std::shared_ptr<const model::CapstanTable> capstan)
    : travel_(p.SpoolTravelPerMotorRad()),
      stiffness_(p.tendon.stiffness_Npm),
      damping_(p.tendon.damping_Nspm),
      stretch0_m_(start_tension_N / p.tendon.stiffness_Npm),
      inertia_(p.motor.rotor_inertia_kgm2),
      coulomb_(p.motor.coulomb_friction_Nm),
      dahl_angle_(p.motor.coulomb_angle_rad),
      dahl_damping_(p.motor.coulomb_damping_Nms),
      viscous_(p.motor.viscous_friction_Nms),
      lag_s_(p.motor.torque_lag_s),
      log_efficiency_(std::log(p.gear.efficiency)),
      slide_step_m_(1e-3 * p.transmission.presliding_m),
      gear_step_rad_(0),
      capstan_(std::move(capstan)),
      pulley_(model::PulleyPresliding(p.transmission.presliding_m)) {
  for (const double yield : p.gear.presliding_yields_rad) {
    gear_.emplace_back(std::array{yield});
    gear_step_rad_ = gear_step_rad_ == 0 ? 1e-3 * yield : std::min(gear_step_rad_, 1e-3 * yield);
  }
  torque_from_ = torque_wanted_ = start_tension_N * travel_;
}

void Drivetrain::SetTorque(double time_s, double wanted_Nm) noexcept {
  torque_from_ = Torque(time_s);
  torque_time_s_ = time_s;
  torque_wanted_ = wanted_Nm;
}

double Drivetrain::Torque(double time_s) const noexcept {
  if (torque_from_ == torque_wanted_) return torque_wanted_;
  if (lag_s_ <= 0) return torque_wanted_;
  return torque_wanted_ + (torque_from_ - torque_wanted_) * std::exp(-(time_s - torque_time_s_) / lag_s_);
}

double Drivetrain::Gear(double angle_rad) const noexcept {
  double z = 0;
  for (const auto& op : gear_) z += op.Peek(angle_rad);
  return gear_.empty() ? 0 : z / static_cast<double>(gear_.size());
}

DrivetrainForces Drivetrain::Evaluate(const DrivetrainMotion& m, double torque_Nm) const noexcept {
  DrivetrainForces f;
  const double pull_m = travel_ * m.angle_rad;
  const double stretch = pull_m - m.shortening_m + stretch0_m_;
  const double stretch_rate = travel_ * m.velocity_radps - m.shortening_rate_mps;
  f.tension_motor_N = std::max(0.0, stiffness_ * stretch + damping_ * stretch_rate);
  f.sliding = pulley_.Peek(0.5 * (pull_m + m.shortening_m));
  f.release_N = capstan_->Release(f.tension_motor_N);
  f.pull_N = capstan_->Pull(f.tension_motor_N);
  f.tension_base_N = 0.5 * (1 + f.sliding) * f.release_N + 0.5 * (1 - f.sliding) * f.pull_N;

  f.gear_factor = std::exp(-log_efficiency_ * Gear(m.angle_rad));
  f.dahl_rate_ps = (m.velocity_radps - std::abs(m.velocity_radps) * m.dahl) / dahl_angle_;
  const double friction = coulomb_ * m.dahl + dahl_damping_ * f.dahl_rate_ps + viscous_ * m.velocity_radps;
  const double load = f.tension_motor_N * travel_ * f.gear_factor;
  f.acceleration_radps2 = (torque_Nm - friction - load) / inertia_;
  return f;
}

double Drivetrain::SlidingSlope(double x_m) const noexcept {
  return (pulley_.Peek(x_m + slide_step_m_) - pulley_.Peek(x_m - slide_step_m_)) / (2 * slide_step_m_);
}

double Drivetrain::GearSlope(double angle_rad) const noexcept {
  if (gear_.empty()) return 0;
  return (Gear(angle_rad + gear_step_rad_) - Gear(angle_rad - gear_step_rad_)) / (2 * gear_step_rad_);
}

// The slope of the pulley's map is taken as its ratio: it is exact for a constant ratio and within some per
// cent for the power law, and only the speed of the solver's iteration depends on it.
DrivetrainLinear Drivetrain::Linearise(const DrivetrainMotion& m, const DrivetrainForces& f,
                                       double gamma) const noexcept {
  DrivetrainLinear l;
  l.travel = travel_;
  double implicit_spring = 0;  // motor-side tension per stretch rate, over the step
  if (f.tension_motor_N > 0) {
    const double ratio = f.tension_base_N / f.tension_motor_N;
    implicit_spring = gamma * (gamma * stiffness_ + damping_);
    l.base_spring = ratio * stiffness_;
    l.base_slide =
        0.25 * (f.release_N - f.pull_N) * SlidingSlope(0.5 * (travel_ * m.angle_rad + m.shortening_m));
    l.rotor_spring = travel_ * f.gear_factor * stiffness_;
    l.rotor_gear = -log_efficiency_ * f.gear_factor * GearSlope(m.angle_rad) * travel_ * f.tension_motor_N;
    l.base_body = ratio * implicit_spring - gamma * gamma * l.base_slide;
    l.base_motor = travel_ * (ratio * implicit_spring + gamma * gamma * l.base_slide);
    l.rotor_body = travel_ * f.gear_factor * implicit_spring;
  }
  const double wear = std::abs(m.velocity_radps) / dahl_angle_;
  const double build = (1 - std::copysign(m.dahl, m.velocity_radps)) / dahl_angle_;
  l.rotor_dahl = coulomb_ - dahl_damping_ * wear;
  l.dahl_relax = 1 + gamma * wear;
  l.dahl_build = gamma * build;
  l.inertia = inertia_ + gamma * (viscous_ + dahl_damping_ * build) +
              gamma * gamma * (build * l.rotor_dahl / l.dahl_relax + l.rotor_gear) + travel_ * l.rotor_body;
  return l;
}

void Drivetrain::Commit(const DrivetrainMotion& m, double step_s) noexcept {
  const double slide = 0.5 * (travel_ * m.angle_rad + m.shortening_m);
  const double slide_rate = 0.5 * (travel_ * m.velocity_radps + m.shortening_rate_mps);
  if (slide_rate * slide_rate_ < 0) {
    pulley_.Commit(TurningPoint(slide_, slide_rate_, slide, slide_rate, step_s));
  }
  pulley_.Commit(slide);
  slide_ = slide;
  slide_rate_ = slide_rate;

  if (m.velocity_radps * velocity_ < 0) {
    const double turn = TurningPoint(angle_, velocity_, m.angle_rad, m.velocity_radps, step_s);
    for (auto& op : gear_) op.Commit(turn);
  }
  for (auto& op : gear_) op.Commit(m.angle_rad);
  angle_ = m.angle_rad;
  velocity_ = m.velocity_radps;
}

}  // namespace tendril::sim
