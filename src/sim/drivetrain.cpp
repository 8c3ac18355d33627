// The drivetrain's laws: tendon spring, pulley friction with pre-sliding, Dahl motor friction, gear
// efficiency. Knows one tendon only.
#include "drivetrain.h"

#include <algorithm>
#include <cmath>

namespace tendril::sim {
namespace {

/// From x0 with velocity v0 to x with velocity v in h seconds: turned when the velocity changed sign. The
/// turning point is the cubic's through both ends, taken at the zero of the straight line between the
/// velocities; it is stationary there, so the error is of second order in that time's.
Way WayTo(double x0, double v0, double x, double v, double h) {
  if (!(v0 * v < 0) || h <= 0) return {x, false, x};
  const double s = v0 / (v0 - v);
  const double r = 1 - s;
  const double turn = r * r * (1 + 2 * s) * x0 + s * s * (3 - 2 * s) * x + h * s * r * (r * v0 - s * v);
  return {x, true, v0 > 0 ? std::max({turn, x0, x}) : std::min({turn, x0, x})};
}

template <typename Memory>
double Peek(const Memory& memory, const Way& way) {
  if (!way.turned) return memory.Peek(way.x);
  Memory turned = memory;
  turned.Commit(way.turn);
  return turned.Peek(way.x);
}

template <typename Memory>
void CommitAlong(Memory& memory, const Way& way) {
  if (way.turned) memory.Commit(way.turn);
  memory.Commit(way.x);
}

Way Moved(Way way, double by) {
  way.x += by;
  return way;
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
      pulley_(model::PulleyPresliding(p.transmission.presliding_m)),
      dahl_(p.motor.coulomb_angle_rad) {
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
  if (torque_from_ == torque_wanted_ || lag_s_ <= 0) return torque_wanted_;
  return torque_wanted_ + (torque_from_ - torque_wanted_) * std::exp(-(time_s - torque_time_s_) / lag_s_);
}

double Drivetrain::Slide(const DrivetrainMotion& m) const noexcept {
  return 0.5 * (travel_ * m.angle_rad + m.shortening_m);
}

double Drivetrain::SlideRate(const DrivetrainMotion& m) const noexcept {
  return 0.5 * (travel_ * m.velocity_radps + m.shortening_rate_mps);
}

Way Drivetrain::SlideWay(double time_s, const DrivetrainMotion& m) const noexcept {
  return WayTo(slide_, slide_rate_, Slide(m), SlideRate(m), time_s - time_s_);
}

Way Drivetrain::ShaftWay(double time_s, const DrivetrainMotion& m) const noexcept {
  return WayTo(angle_, velocity_, m.angle_rad, m.velocity_radps, time_s - time_s_);
}

double Drivetrain::Gear(Way way) const noexcept {
  double z = 0;
  for (const auto& op : gear_) z += Peek(op, way);
  return gear_.empty() ? 0 : z / static_cast<double>(gear_.size());
}

DrivetrainForces Drivetrain::Evaluate(double time_s, const DrivetrainMotion& m) const noexcept {
  DrivetrainForces f;
  f.slide = SlideWay(time_s, m);
  f.shaft = ShaftWay(time_s, m);

  const double stretch = travel_ * m.angle_rad - m.shortening_m + stretch0_m_;
  const double stretch_rate = travel_ * m.velocity_radps - m.shortening_rate_mps;
  f.tension_motor_N = std::max(0.0, stiffness_ * stretch + damping_ * stretch_rate);
  f.sliding = Peek(pulley_, f.slide);
  f.release_N = capstan_->Release(f.tension_motor_N);
  f.pull_N = capstan_->Pull(f.tension_motor_N);
  f.tension_base_N = 0.5 * (1 + f.sliding) * f.release_N + 0.5 * (1 - f.sliding) * f.pull_N;

  f.torque_Nm = Torque(time_s);
  f.dahl = Peek(dahl_, f.shaft);
  f.gear_factor = std::exp(-log_efficiency_ * Gear(f.shaft));
  const double dahl_rate = (m.velocity_radps - std::abs(m.velocity_radps) * f.dahl) / dahl_angle_;
  const double friction = coulomb_ * f.dahl + dahl_damping_ * dahl_rate + viscous_ * m.velocity_radps;
  const double load = f.tension_motor_N * travel_ * f.gear_factor;
  f.acceleration_radps2 = (f.torque_Nm - friction - load) / inertia_;
  return f;
}

// The slope of the pulley's map is taken as its ratio: exact for a constant ratio and within some per cent
// for the power law, and only the speed of the solver's iteration depends on it.
DrivetrainLinear Drivetrain::Linearise(const DrivetrainMotion& m, const DrivetrainForces& f,
                                       double gamma) const noexcept {
  DrivetrainLinear l;
  l.travel = travel_;
  double implicit_spring = 0;  // motor-side tension per stretch rate, over the step
  if (f.tension_motor_N > 0) {
    const double ratio = f.tension_base_N / f.tension_motor_N;
    const double slide_slope =
        (Peek(pulley_, Moved(f.slide, slide_step_m_)) - Peek(pulley_, Moved(f.slide, -slide_step_m_))) /
        (2 * slide_step_m_);
    implicit_spring = gamma * (gamma * stiffness_ + damping_);
    l.base_spring = ratio * stiffness_;
    l.base_slide = 0.25 * (f.release_N - f.pull_N) * slide_slope;
    l.rotor_spring = travel_ * f.gear_factor * stiffness_;
    if (!gear_.empty()) {
      const double gear_slope =
          (Gear(Moved(f.shaft, gear_step_rad_)) - Gear(Moved(f.shaft, -gear_step_rad_))) /
          (2 * gear_step_rad_);
      l.rotor_friction = -log_efficiency_ * f.gear_factor * gear_slope * travel_ * f.tension_motor_N;
    }
    l.base_body = ratio * implicit_spring - gamma * gamma * l.base_slide;
    l.base_motor = travel_ * (ratio * implicit_spring + gamma * gamma * l.base_slide);
    l.rotor_body = travel_ * f.gear_factor * implicit_spring;
  }
  const double build = (1 - std::copysign(f.dahl, m.velocity_radps)) / dahl_angle_;
  l.rotor_friction += build * (coulomb_ - dahl_damping_ * std::abs(m.velocity_radps) / dahl_angle_);
  l.inertia = inertia_ + gamma * (viscous_ + dahl_damping_ * build) + gamma * gamma * l.rotor_friction +
              travel_ * l.rotor_body;
  return l;
}

void Drivetrain::Commit(double time_s, const DrivetrainMotion& m) noexcept {
  CommitAlong(pulley_, SlideWay(time_s, m));
  const Way shaft = ShaftWay(time_s, m);
  CommitAlong(dahl_, shaft);
  for (auto& op : gear_) CommitAlong(op, shaft);
  slide_ = Slide(m);
  slide_rate_ = SlideRate(m);
  angle_ = m.angle_rad;
  velocity_ = m.velocity_radps;
  time_s_ = time_s;
}

}  // namespace tendril::sim
