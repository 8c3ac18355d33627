// The drivetrain's laws: tendon spring, pulley friction with pre-sliding, Dahl motor friction, gear
// efficiency, and what effects add to them. Knows one tendon only.
#include "drivetrain.h"

#include <algorithm>
#include <cmath>

namespace tendril::sim {
namespace {

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

// A turning point exists when the velocity changed sign. It is that of the cubic through both ends, taken at
// the zero of the linearly interpolated velocity; the cubic is stationary there, so the error is of second
// order in that time's.
Way WayTo(double x0, double v0, double x, double v, double h) noexcept {
  if (!(v0 * v < 0) || h <= 0) return {x, false, x};
  const double s = v0 / (v0 - v);
  const double r = 1 - s;
  const double turn = r * r * (1 + 2 * s) * x0 + s * s * (3 - 2 * s) * x + h * s * r * (r * v0 - s * v);
  return {x, true, v0 > 0 ? std::max({turn, x0, x}) : std::min({turn, x0, x})};
}

Drivetrain::Drivetrain(const TendonDriveParameters& p, double start_tension_N,
                       std::shared_ptr<const model::CapstanTable> capstan, const TendonLaws& laws)
    : travel_(p.SpoolTravelPerMotorRad()),
      stiffness_(p.tendon.stiffness_Npm),
      damping_(p.tendon.damping_Nspm),
      stretch0_m_(start_tension_N / p.tendon.stiffness_Npm - laws.slack_m),
      inertia_(p.motor.rotor_inertia_kgm2),
      coulomb_(p.motor.coulomb_friction_Nm),
      dahl_angle_(p.motor.coulomb_angle_rad),
      dahl_damping_(p.motor.coulomb_damping_Nms),
      viscous_(p.motor.viscous_friction_Nms),
      torque_scale_(p.motor.torque_scale),
      log_efficiency_(std::log(p.gear.efficiency)),
      pulley_coulomb_N_(p.transmission.coulomb_N),
      low_tension_N_(p.transmission.low_tension_N),
      slide_step_m_(1e-3 * p.transmission.presliding_m),
      gear_step_rad_(0),
      capstan_(std::move(capstan)),
      pulley_(model::PulleyPresliding(p.transmission.presliding_m)),
      dahl_(p.motor.coulomb_angle_rad),
      loop_(start_tension_N * travel_ / torque_scale_, p.motor.torque_lag_s, laws.command_delay_s,
            laws.torque_limit_Nm),
      shaft_laws_(laws.shaft),
      stretch_laws_(laws.stretch),
      growth_per_rad_m_(laws.spool_growth_mprad / (p.gear.ratio * p.gear.ratio)),
      plain_spool_(laws.play_rad == 0 && laws.spool_growth_mprad == 0),
      play_(laws.play_rad) {
  for (const double yield : p.gear.presliding_yields_rad) {
    gear_.emplace_back(std::array{yield});
    gear_step_rad_ = gear_step_rad_ == 0 ? 1e-3 * yield : std::min(gear_step_rad_, 1e-3 * yield);
  }
  for (auto& law : stretch_laws_) law->Start(start_tension_N, stiffness_);
}

Way Drivetrain::ShaftWay(double time_s, const DrivetrainMotion& m) const noexcept {
  return WayTo(angle_, velocity_, m.angle_rad, m.velocity_radps, time_s - time_s_);
}

// The radius grows with the wound angle: r(phi) = r + g phi, s = r phi + g phi^2 / 2.
Drivetrain::Spool Drivetrain::SpoolAt(const Way& shaft, const DrivetrainMotion& m) const noexcept {
  if (plain_spool_) return {travel_ * m.angle_rad, travel_ * m.velocity_radps, travel_, travel_};
  const double driven = Peek(play_, shaft);
  // On a flank when the driven side moves with the shaft: the near one pulls, the far one pays out.
  const bool carried = driven == (m.velocity_radps >= 0 ? m.angle_rad : m.angle_rad + play_.play());
  const double arm = travel_ + growth_per_rad_m_ * driven;
  const double per_rad = carried ? arm : 0;
  return {(travel_ + 0.5 * growth_per_rad_m_ * driven) * driven, per_rad * m.velocity_radps, per_rad, arm};
}

// The pulley lies half way along the tendon.
Way Drivetrain::SlideWay(double time_s, const DrivetrainMotion& m, const Spool& spool) const noexcept {
  return WayTo(slide_, slide_rate_, 0.5 * (spool.pull_m + m.shortening_m),
               0.5 * (spool.rate_mps + m.shortening_rate_mps), time_s - time_s_);
}

double Drivetrain::Stretched(double time_s, const DrivetrainMotion& m, const Spool& spool) const noexcept {
  double stretch = spool.pull_m - m.shortening_m + stretch0_m_;
  for (const auto& law : stretch_laws_) stretch -= law->Peek(time_s);
  const double rate = spool.rate_mps - m.shortening_rate_mps;
  return std::max(0.0, stiffness_ * stretch + damping_ * rate);
}

// The pulleys' bearings take a tension independent of the load; a slack tendon cannot turn them.
double Drivetrain::Base(double tension_motor_N, double z, double release_N, double pull_N) const noexcept {
  const double base = 0.5 * (1 + z) * release_N + 0.5 * (1 - z) * pull_N;
  if (pulley_coulomb_N_ == 0) return base;
  return std::max(0.0, base - z * pulley_coulomb_N_ * std::min(1.0, tension_motor_N / low_tension_N_));
}

PulleyMap Drivetrain::Pulleys(double tension_motor_N) const noexcept {
  const double release = capstan_->Release(tension_motor_N), pull = capstan_->Pull(tension_motor_N);
  const double bearings = pulley_coulomb_N_ * std::min(1.0, tension_motor_N / low_tension_N_);
  return {0.5 * (release + pull), 0.5 * (pull - release) + bearings};
}

double Drivetrain::Gear(const Way& way) const noexcept {
  double z = 0;
  for (const auto& op : gear_) z += Peek(op, way);
  return gear_.empty() ? 0 : z / static_cast<double>(gear_.size());
}

double Drivetrain::Resistance(const DrivetrainMotion& m, DrivetrainForces& f) const noexcept {
  f.dahl = Peek(dahl_, f.shaft);
  const double dahl_rate = (m.velocity_radps - std::abs(m.velocity_radps) * f.dahl) / dahl_angle_;
  double resistance = coulomb_ * f.dahl + dahl_damping_ * dahl_rate + viscous_ * m.velocity_radps;
  if (shaft_laws_.empty()) return resistance;
  const double build = (1 - std::copysign(f.dahl, m.velocity_radps)) / dahl_angle_;
  for (const auto& law : shaft_laws_) {
    const ShaftTorque t = law->Against({m.angle_rad, m.velocity_radps, f.dahl, build});
    f.extra.torque_Nm += t.torque_Nm;
    f.extra.per_angle += t.per_angle;
    f.extra.per_velocity += t.per_velocity;
  }
  return resistance + f.extra.torque_Nm;
}

// The gear's losses follow the direction of power: with z_g of the motion for a load that the motor lifts,
// against it for one that pulls the motor on.
DrivetrainForces Drivetrain::Evaluate(double time_s, const DrivetrainMotion& m,
                                      double opposing_Nm) const noexcept {
  DrivetrainForces f;
  f.shaft = ShaftWay(time_s, m);
  const Spool spool = SpoolAt(f.shaft, m);
  f.spool_pull_m = spool.pull_m;
  f.pull_m_per_rad = spool.per_rad_m;
  f.load_arm_m = spool.arm_m;
  f.slide = SlideWay(time_s, m, spool);

  f.tension_motor_N = Stretched(time_s, m, spool);
  f.sliding = Peek(pulley_, f.slide);
  f.release_N = capstan_->Release(f.tension_motor_N);
  f.pull_N = capstan_->Pull(f.tension_motor_N);
  f.tension_base_N = Base(f.tension_motor_N, f.sliding, f.release_N, f.pull_N);

  f.torque_Nm = torque_scale_ * Torque(time_s);
  const double lossless_Nm = f.tension_motor_N * spool.arm_m - opposing_Nm;
  f.gear_factor = std::exp((lossless_Nm < 0 ? 1 : -1) * log_efficiency_ * Gear(f.shaft));
  const double load = lossless_Nm * f.gear_factor;
  f.acceleration_radps2 = (f.torque_Nm - Resistance(m, f) - load) / inertia_;
  return f;
}

double Drivetrain::TensionFromTorque(double time_s, const DrivetrainMotion& m, double torque_Nm,
                                     double acceleration_radps2) const noexcept {
  DrivetrainForces f;
  f.shaft = ShaftWay(time_s, m);
  const double load = torque_scale_ * torque_Nm - Resistance(m, f) - inertia_ * acceleration_radps2;
  const double arm = SpoolAt(f.shaft, m).arm_m;
  return std::max(0.0, load / (arm * std::exp(-log_efficiency_ * Gear(f.shaft))));
}

double Drivetrain::TensionFromStretch(double time_s, const DrivetrainMotion& m) const noexcept {
  return Stretched(time_s, m, SpoolAt(ShaftWay(time_s, m), m));
}

double Drivetrain::BaseTension(double time_s, const DrivetrainMotion& m,
                               double tension_motor_N) const noexcept {
  const double tension = std::max(0.0, tension_motor_N);
  const double z = Peek(pulley_, SlideWay(time_s, m, SpoolAt(ShaftWay(time_s, m), m)));
  return Base(tension, z, capstan_->Release(tension), capstan_->Pull(tension));
}

// The slope of the pulley's map is approximated by its ratio: exact for a constant ratio, within some per
// cent for the power law, and relevant only for the speed of the solver's iteration.
DrivetrainLinear Drivetrain::Linearise(const DrivetrainMotion& m, const DrivetrainForces& f,
                                       double gamma) const noexcept {
  DrivetrainLinear l;
  l.travel = f.pull_m_per_rad;
  double implicit_spring = 0;  // motor-side tension per stretch rate, over the step
  if (f.tension_motor_N > 0) {
    const double ratio = f.tension_base_N / f.tension_motor_N;
    const double slide_slope =
        (Peek(pulley_, Moved(f.slide, slide_step_m_)) - Peek(pulley_, Moved(f.slide, -slide_step_m_))) /
        (2 * slide_step_m_);
    implicit_spring = gamma * (gamma * stiffness_ + damping_);
    l.base_spring = ratio * stiffness_;
    l.base_slide = 0.25 * (f.release_N - f.pull_N - 2 * pulley_coulomb_N_) * slide_slope;
    l.rotor_spring = f.load_arm_m * f.gear_factor * stiffness_;
    if (!gear_.empty()) {
      const double gear_slope =
          (Gear(Moved(f.shaft, gear_step_rad_)) - Gear(Moved(f.shaft, -gear_step_rad_))) /
          (2 * gear_step_rad_);
      l.rotor_friction = -log_efficiency_ * f.gear_factor * gear_slope * f.load_arm_m * f.tension_motor_N;
    }
    l.base_body = ratio * implicit_spring - gamma * gamma * l.base_slide;
    l.base_motor = l.travel * (ratio * implicit_spring + gamma * gamma * l.base_slide);
    l.rotor_body = f.load_arm_m * f.gear_factor * implicit_spring;
  }
  const double build = (1 - std::copysign(f.dahl, m.velocity_radps)) / dahl_angle_;
  l.rotor_friction +=
      build * (coulomb_ - dahl_damping_ * std::abs(m.velocity_radps) / dahl_angle_) + f.extra.per_angle;
  l.inertia = inertia_ + gamma * (viscous_ + dahl_damping_ * build + f.extra.per_velocity) +
              gamma * gamma * l.rotor_friction + l.travel * l.rotor_body;
  return l;
}

void Drivetrain::Commit(double time_s, const DrivetrainMotion& m) noexcept {
  const Way shaft = ShaftWay(time_s, m);
  const Spool spool = SpoolAt(shaft, m);
  if (!stretch_laws_.empty()) {
    const double tension = Stretched(time_s, m, spool);
    for (auto& law : stretch_laws_) law->Commit(time_s, tension);
  }
  const Way slide = SlideWay(time_s, m, spool);
  CommitAlong(pulley_, slide);
  CommitAlong(dahl_, shaft);
  for (auto& op : gear_) CommitAlong(op, shaft);
  CommitAlong(play_, shaft);
  slide_ = slide.x;
  slide_rate_ = 0.5 * (spool.rate_mps + m.shortening_rate_mps);
  angle_ = m.angle_rad;
  velocity_ = m.velocity_radps;
  time_s_ = time_s;
}

}  // namespace tendril::sim
