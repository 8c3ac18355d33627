// The plant: body and drivetrains as one system of ordinary differential equations, with sensors. States:
// unit bending q, motor angles and their rates; of a pair the second tendon's angle is the first's, turned
// round. Friction memories are functions of position with state: read within the solver's steps, moved only
// at accepted steps.
#include "tendril/sim/plant.h"

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <deque>
#include <numbers>
#include <random>
#include <stdexcept>

#include "actuation.h"
#include "capstan_cache.h"
#include "drivetrain.h"
#include "integrator.h"
#include "laws.h"
#include "sensors.h"
#include "tendril/sim/effects.h"

namespace tendril::sim {
namespace {

using ConstVector = Eigen::Map<const Eigen::VectorXd>;
using Vector = Eigen::Map<Eigen::VectorXd>;

// Newton's matrix uses mass and stiffness at a reference shape, recomputed beyond this bend or share of the
// largest tension from it. This affects the speed of the iteration, not its solution.
constexpr double kNewtonBend_rad = 0.05;
// A piece of wire between two disks has a thousandth of a disk's inertia or less. Whatever a mass matrix of
// another shape is off there counts that much more.
constexpr double kNewtonStrain = 1e-3;
constexpr double kNewtonTension = 0.125;

constexpr double kCapstan = 1e-6;  // relative error of the Capstan tables

// A reversal within a step is detected from the velocities at both ends, so two reversals of a motor that
// oscillates on its micro-slip (some 100 Hz) must not fall into one step.
constexpr double kLongestStep_s = 0.5e-3;

// The tracker has a separate random sequence, so that reading it leaves the drives' noise unchanged.
constexpr std::uint64_t kTrackerSeed = 0x9E3779B97F4A7C15;

class Noise {
 public:
  Noise(bool on, std::uint64_t seed) : on_(on), random_(seed) {}

  double Draw(double rms) {
    // Always drawn, so that a run's noise does not depend on which sensors have noise.
    const double value = normal_(random_);
    return on_ ? rms * value : 0;
  }

 private:
  bool on_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace

struct Plant::Impl final : OdeSystem {
  Impl(const RobotParameters& robot_parameters, const PlantOptions& plant_options)
      : robot(FoldEffects(robot_parameters)),
        laws(PlantLaws::Of(robot)),
        options(plant_options),
        actuation(Actuation(robot, "the plant")),
        sensor(actuation, laws.sensor),
        body(robot.body),
        workspace(body),
        n(body.dof()),
        m(body.tendons()),
        newton_strain(body.bends_only() ? kNewtonBend_rad : kNewtonStrain),
        cholesky(n),
        lu(n),
        sensor_noise(plant_options.sensor_noise, plant_options.seed),
        tracker_noise(plant_options.sensor_noise, plant_options.seed + kTrackerSeed) {
    for (std::size_t j = 0; j < actuation.tendons.size(); ++j) {
      const TendonDriveParameters& tendon = actuation.tendons[j];
      drive.emplace_back(tendon, robot.RestTension_N(static_cast<int>(j)),
                         CachedCapstanTable(tendon.transmission, TabulatedTo_N(robot), kCapstan),
                         laws.tendon[j]);
    }
    for (const TendonPair& pair : actuation.pairs) drive[pair.first].StartWithTorque(0);
    length_jacobian.setZero(m, n);
    weighted.setZero(m, n);
    shortening.setZero(m);
    shortening_rate.setZero(m);
    tension.setZero(m);
    force.setZero(n);
    evaluated_q.setZero(n);
    motion.resize(m);
    forces.resize(m);
    settled.resize(m);
    linear.resize(m);
    state.resize(m);
    mass.setZero(n, n);
    stiffness.setZero(n, n);
    newton.setZero(n, n);
    weight.setZero(m);
    between.setZero(static_cast<Eigen::Index>(actuation.pairs.size()));
    known.setZero(m);
    rotor.setZero(m);
    moved.setZero(m);
    body_rhs.setZero(n);
    q.setZero(n);
    dq.setZero(n);

    integrator = std::make_unique<Integrator>(*this, Eigen::VectorXd::Zero(2 * (n + m)), StateTolerances(),
                                              kLongestStep_s, !body.bends_only());
    ReadState();
    UpdateTendonStates();
    RememberPose();
  }

  // ---- layout of the state: q, motor angles, dq, motor velocities ----
  int angle_at(int j) const { return n + j; }
  int rate_at() const { return n + m; }
  int velocity_at(int j) const { return 2 * n + m + j; }

  /// One tolerance per state, each equivalent to the same change of tendon tension: the given one is for
  /// bending; a motor angle counts by the stretch it causes, a rate by the damper's tension.
  Integrator::Tolerances StateTolerances() const {
    const double bend = options.absolute_tolerance;
    Eigen::VectorXd absolute = Eigen::VectorXd::Constant(2 * (n + m), bend);
    double slowest = 1e300;
    for (int j = 0; j < m; ++j) {
      const auto& d = drive[j];
      const auto [section, route] = Route(j);
      const double stretch = bend * route.radius_m;
      const double rate =
          d.damping_Nspm() > 0 ? std::min(d.stiffness_Npm() / d.damping_Nspm(), kFastest) : kFastest;
      slowest = std::min(slowest, rate);
      absolute[angle_at(j)] = stretch / d.travel_m_per_rad();
      absolute[velocity_at(j)] = rate * stretch / d.travel_m_per_rad();
    }
    absolute.segment(rate_at(), n).setConstant(slowest * bend);
    return {options.relative_tolerance, absolute};
  }
  static constexpr double kFastest =
      1500;  // 1/s: rates that move a sensor within a fraction of a millisecond

  std::pair<int, TendonRoute> Route(int tendon) const {
    int section = 0;
    while (tendon >= static_cast<int>(robot.body.sections[section].tendons.size())) {
      tendon -= static_cast<int>(robot.body.sections[section].tendons.size());
      ++section;
    }
    return {section, robot.body.sections[section].tendons[tendon]};
  }

  // ---- equations of motion ----
  bool Derivative(double t, const double* y, double* derivative) noexcept override {
    const ConstVector bend(y, n), bend_rate(y + rate_at(), n);
    if (!bend.allFinite() || !bend_rate.allFinite()) return false;
    body.TendonShortening(bend, shortening, length_jacobian);
    shortening_rate.noalias() = -(length_jacobian * bend_rate);
    evaluated_q = bend;
    for (int j = 0; j < m; ++j) {
      motion[j] = {y[angle_at(j)], y[velocity_at(j)], shortening[j], shortening_rate[j]};
      forces[j] = drive[j].Evaluate(t, motion[j]);
    }
    for (const TendonPair& pair : actuation.pairs) PullTogether(t, pair, forces);
    for (int j = 0; j < m; ++j) {
      tension[j] = forces[j].tension_base_N;
      derivative[angle_at(j)] = y[velocity_at(j)];
      derivative[velocity_at(j)] = forces[j].acceleration_radps2;
    }
    if (laws.body.empty()) {
      force.noalias() = -(length_jacobian.transpose() * tension);
    } else {
      laws.body.WeighLengths(body, bend, length_jacobian, weighted);
      force.noalias() = -(weighted.transpose() * tension);
      laws.body.AddForce(body, bend, bend_rate, t, force);
    }
    Vector(derivative, n) = bend_rate;
    Vector acceleration(derivative + rate_at(), n);
    body.ForwardDynamics(bend, bend_rate, force, acceleration, workspace);
    return acceleration.allFinite();
  }

  /// One shaft with the loads of both tendons.
  void PullTogether(double t, const TendonPair& pair, std::vector<DrivetrainForces>& of) const noexcept {
    DrivetrainForces &first = of[pair.first], &second = of[pair.second];
    first = drive[pair.first].Evaluate(t, motion[pair.first], second.tension_motor_N * second.load_arm_m);
    second.acceleration_radps2 = -first.acceleration_radps2;
    second.torque_Nm = -first.torque_Nm;
  }

  /// (I - gamma df/dy) x = b with the rows of the body multiplied by the mass matrix and the motors, whose
  /// block is diagonal, eliminated; what is left is symmetric in the bending rates:
  ///   [H + gamma D + gamma^2 K + J^T W J] dv = ...,  J = dL/dq,
  /// W diagonal but for pairs, whose tensions change with each other's paths.
  bool SolveNewton(double gamma, const double* b, double* x) noexcept override {
    if (reference_q.size() == 0 || (evaluated_q - reference_q).cwiseAbs().maxCoeff() > newton_strain ||
        (tension - reference_tension).cwiseAbs().maxCoeff() >
            kNewtonTension * robot.limits.max_tension_base_N) {
      body.MassMatrix(evaluated_q, mass, workspace);
      body.TangentStiffness(evaluated_q, tension, Eigen::Vector3d::Zero(), stiffness);
      reference_q = evaluated_q;
      reference_tension = tension;
      ++jacobians;
    }
    const ConstVector b_bend(b, n), b_rate(b + rate_at(), n);
    moved.noalias() = -(length_jacobian * b_bend);  // known change of shortening
    for (int j = 0; j < m; ++j) {
      linear[j] = drive[j].Linearise(motion[j], forces[j], gamma);
      const auto& l = linear[j];
      const double angle = b[angle_at(j)];
      rotor[j] = drive[j].rotor_inertia_kgm2() * b[velocity_at(j)] + gamma * l.RotorTorque(angle, moved[j]);
      known[j] = gamma * l.BaseTension(angle, moved[j]) + l.base_motor * rotor[j] / l.inertia;
      weight[j] = l.base_body - l.base_motor * l.rotor_body / l.inertia;
    }
    for (std::size_t i = 0; i < actuation.pairs.size(); ++i) LineariseTogether(i, gamma, b);
    Vector rate(x + rate_at(), n);
    const bool solved = laws.body.empty() ? SolveBending(gamma, b_bend, b_rate, rate)
                                          : SolveBendingWithLaws(gamma, b_bend, b_rate, rate);
    if (!solved) return false;
    Vector(x, n) = b_bend + gamma * rate;
    moved.noalias() = length_jacobian * rate;
    for (int j = 0; j < m; ++j) {
      const double velocity = (rotor[j] - linear[j].rotor_body * moved[j]) / linear[j].inertia;
      x[velocity_at(j)] = velocity;
      x[angle_at(j)] = b[angle_at(j)] + gamma * velocity;
    }
    for (const TendonPair& pair : actuation.pairs) {
      const DrivetrainLinear &first = linear[pair.first], &second = linear[pair.second];
      const double velocity = (rotor[pair.first] - first.rotor_body * moved[pair.first] +
                               second.rotor_body * moved[pair.second]) /
                              first.inertia;
      x[velocity_at(pair.first)] = velocity;
      x[angle_at(pair.first)] = b[angle_at(pair.first)] + gamma * velocity;
      x[velocity_at(pair.second)] = -velocity;
      x[angle_at(pair.second)] = b[angle_at(pair.second)] - gamma * velocity;
    }
    return true;
  }

  /// The rotor of a pair's first tendon bears both; `between` is their entry of W, the mean of the two, which
  /// differ as much as the tendons' pulleys do.
  void LineariseTogether(std::size_t i, double gamma, const double* b) noexcept {
    const TendonPair& pair = actuation.pairs[i];
    DrivetrainLinear &first = linear[pair.first], &second = linear[pair.second];
    const double gear = forces[pair.first].gear_factor / forces[pair.second].gear_factor;
    second.rotor_body *= gear;
    second.rotor_spring *= gear;
    first.inertia += second.travel * second.rotor_body;
    rotor[pair.first] +=
        gamma * second.rotor_spring * (second.travel * b[angle_at(pair.second)] - moved[pair.second]);
    const auto known_of = [&](int j, double side) {
      return gamma * linear[j].BaseTension(b[angle_at(j)], moved[j]) +
             side * linear[j].base_motor * rotor[pair.first] / first.inertia;
    };
    known[pair.first] = known_of(pair.first, 1);
    known[pair.second] = known_of(pair.second, -1);
    weight[pair.first] = first.base_body - first.base_motor * first.rotor_body / first.inertia;
    weight[pair.second] = second.base_body - second.base_motor * second.rotor_body / first.inertia;
    between[static_cast<Eigen::Index>(i)] =
        (first.base_motor * second.rotor_body + second.base_motor * first.rotor_body) / (2 * first.inertia);
  }

  /// Adds J_left^T W J, by the tendons' weights.
  void AddWeights(const Eigen::MatrixXd& left) noexcept {
    for (int j = 0; j < m; ++j)
      newton.noalias() += weight[j] * left.row(j).transpose() * length_jacobian.row(j);
    for (std::size_t i = 0; i < actuation.pairs.size(); ++i) {
      const TendonPair& pair = actuation.pairs[i];
      const double w = between[static_cast<Eigen::Index>(i)];
      newton.noalias() += w * left.row(pair.first).transpose() * length_jacobian.row(pair.second);
      newton.noalias() += w * left.row(pair.second).transpose() * length_jacobian.row(pair.first);
    }
  }

  bool SolveBending(double gamma, const ConstVector& b_bend, const ConstVector& b_rate, Vector& rate) {
    newton = mass + gamma * gamma * stiffness;
    for (int i = 0; i < n; ++i) newton(i, i) += gamma * body.damping_Nms()[i];
    AddWeights(length_jacobian);
    body_rhs.noalias() = mass * b_rate;
    body_rhs.noalias() -= gamma * (stiffness * b_bend);
    body_rhs.noalias() -= length_jacobian.transpose() * known;
    cholesky.compute(newton);
    if (cholesky.info() != Eigen::Success) return false;
    rate = body_rhs;
    cholesky.solveInPlace(rate);
    return true;
  }

  /// The same with J^T of the forces weighted by the shares of tension, which then differs from J of the
  /// motion, and with the laws' own stiffness, whose memories change from step to step.
  bool SolveBendingWithLaws(double gamma, const ConstVector& b_bend, const ConstVector& b_rate,
                            Vector& rate) {
    law_stiffness = stiffness;
    laws.body.AddStiffness(body, evaluated_q, tension, law_stiffness);
    newton = mass + gamma * gamma * law_stiffness;
    for (int i = 0; i < n; ++i) newton(i, i) += gamma * body.damping_Nms()[i];
    AddWeights(weighted);
    body_rhs.noalias() = mass * b_rate;
    body_rhs.noalias() -= gamma * (law_stiffness * b_bend);
    body_rhs.noalias() -= weighted.transpose() * known;
    lu.compute(newton);
    rate = lu.solve(body_rhs);
    return rate.allFinite();
  }

  // ---- after accepted steps ----

  /// Tendon paths at the accepted point, by the tangent at the iterate of their last evaluation if within the
  /// solver's tolerance, else evaluated again.
  void ReadState() {
    const Eigen::VectorXd& y = integrator->y();
    q = y.head(n);
    dq = y.segment(rate_at(), n);
    if ((q - evaluated_q).cwiseAbs().maxCoeff() > 1e-5) {
      body.TendonShortening(q, shortening, length_jacobian);
    } else {
      shortening.noalias() -= length_jacobian * (q - evaluated_q);
    }
    evaluated_q = q;
    shortening_rate.noalias() = -(length_jacobian * dq);
    for (int j = 0; j < m; ++j) {
      motion[j] = {y[angle_at(j)], y[velocity_at(j)], shortening[j], shortening_rate[j]};
    }
  }

  void Advance(TimeNs dt_ns) {
    if (dt_ns <= 0) throw std::invalid_argument(fmt::format("plant: cannot advance by {} ns", dt_ns));
    const double end = ToSeconds(time_ns + dt_ns);
    while (integrator->t() < end) {
      integrator->StepTowards(NextStop(end));
      ReadState();
      for (int j = 0; j < m; ++j) drive[j].Commit(integrator->t(), motion[j]);
      if (!laws.body.empty()) laws.body.Commit(body, q, integrator->t());
    }
    time_ns += dt_ns;
    UpdateTendonStates();
    RememberPose();
  }

  /// `end`, or an earlier corner of a drive's torque. Corners within a nanosecond of either end are merged
  /// with it, because times are rounded sums.
  double NextStop(double end) const {
    constexpr double kSame_s = 1e-9;
    double stop = end;
    for (const Drivetrain& d : drive) {
      const double corner = d.NextCorner(integrator->t() + kSame_s);
      if (corner < stop - kSame_s) stop = corner;
    }
    return stop;
  }

  void UpdateTendonStates() {
    const double now = ToSeconds(time_ns);
    for (int j = 0; j < m; ++j) settled[j] = drive[j].Evaluate(now, motion[j]);
    for (const TendonPair& pair : actuation.pairs) PullTogether(now, pair, settled);
    for (int j = 0; j < m; ++j) {
      const DrivetrainForces& f = settled[j];
      state[j] = {motion[j].angle_rad,    motion[j].velocity_radps, f.torque_Nm,      f.spool_pull_m,
                  motion[j].shortening_m, f.tension_motor_N,        f.tension_base_N, f.sliding};
    }
  }

  // ---- sensors ----

  std::vector<TendonSensors> ReadSensors() {
    std::vector<TendonSensors> sensors(m);
    const double now = ToSeconds(time_ns);
    for (int j = 0; j < m; ++j) {
      const auto& p = actuation.tendons[j];
      const double turns = sensor.Reported(j, state[j].motor_angle_rad) / (2 * std::numbers::pi);
      sensors[j].encoder_counts =
          static_cast<std::int32_t>(std::llround(turns * p.drive.encoder_counts_per_turn));
      const double permille = p.drive.rated_torque_Nm * 1e-3;
      sensors[j].torque_Nm = permille * std::round(ShaftTorque(j, now) / permille +
                                                   sensor_noise.Draw(p.drive.actual_torque_noise_permille));
      const double cell = sensor_noise.Draw(p.load_cell.noise_N);
      if (p.load_cell.place == LoadCellPlace::kNone) continue;
      const double tension_N =
          p.load_cell.place == LoadCellPlace::kMotorSide ? state[j].tension_motor_N : state[j].tension_base_N;
      const double volts = p.load_cell.gain_VpN * sensor.Shown(j, tension_N + cell, now);
      sensors[j].load_cell_V = p.load_cell.resolution_V * std::round(volts / p.load_cell.resolution_V);
    }
    return sensors;
  }

  /// As the drive of a tendon reports it; of a pair's second tendon the first's, turned round.
  double ShaftTorque(int j, double now) const {
    if (actuation.HasDrive(j)) return drive[j].Torque(now);
    return -drive[actuation.PairOf(j)->first].Torque(now);
  }

  void RememberPose() {
    if (!actuation.tracker || actuation.tracker->delay_s <= 0) return;
    const double now = ToSeconds(time_ns);
    past.push_back({now, q});
    while (past.size() > 2 && past[1].first <= now - actuation.tracker->delay_s) past.pop_front();
  }

  /// Shape reported by the tracker now: that of delay_s ago, interpolated linearly between the plant's
  /// advances.
  Eigen::VectorXd TrackedShape() const {
    if (past.empty()) return q;
    const double when = ToSeconds(time_ns) - actuation.tracker->delay_s;
    const auto& [t0, q0] = past.front();
    if (past.size() < 2 || when <= t0) return q0;
    const auto& [t1, q1] = past[1];
    return q0 + std::min(1.0, (when - t0) / (t1 - t0)) * (q1 - q0);
  }

  TrackerReading ReadTracker() {
    TrackerReading reading;
    const model::Pose pose = sensor.Tracked(body.TipPose(TrackedShape()));
    const TrackerParameters tracker = actuation.tracker.value_or(TrackerParameters{});
    Eigen::Vector3d turn;
    for (int i = 0; i < 3; ++i)
      reading.tip_W_m[i] = pose.p_WA[i] + tracker_noise.Draw(tracker.position_noise_m);
    for (int i = 0; i < 3; ++i) turn[i] = tracker_noise.Draw(tracker.orientation_noise_rad);
    reading.orientation_WT = Eigen::Quaterniond(Eigen::Matrix3d(pose.R_WA * Rotation(turn)));
    if (reading.orientation_WT.w() < 0) reading.orientation_WT.coeffs() *= -1;
    return reading;
  }

  RobotParameters robot;  // with the parameter effects folded in
  PlantLaws laws;         // the law effects
  PlantOptions options;
  const ActuationParameters& actuation;
  Sensors sensor;
  model::Body body;
  model::Body::Workspace workspace;
  int n, m;  // coordinates of the body, tendons
  double newton_strain;
  std::vector<Drivetrain> drive;

  // As last evaluated, within a step or at its accepted end.
  Eigen::MatrixXd length_jacobian;
  Eigen::MatrixXd weighted;  // length_jacobian times the shares of base tension, where a law needs it
  Eigen::VectorXd shortening, shortening_rate, tension, force, evaluated_q;
  std::vector<DrivetrainMotion> motion;
  std::vector<DrivetrainForces> forces;
  std::vector<DrivetrainForces> settled;  // at the end of the last advance

  // Newton's equations.
  std::vector<DrivetrainLinear> linear;
  Eigen::MatrixXd mass, stiffness, newton;
  Eigen::VectorXd reference_q, reference_tension;
  Eigen::VectorXd weight, between, known, rotor, moved, body_rhs;
  Eigen::MatrixXd law_stiffness;
  Eigen::LLT<Eigen::MatrixXd> cholesky;
  Eigen::PartialPivLU<Eigen::MatrixXd> lu;
  std::uint64_t jacobians = 0;

  std::unique_ptr<Integrator> integrator;
  TimeNs time_ns = 0;
  Eigen::VectorXd q, dq;
  std::vector<TendonState> state;
  std::deque<std::pair<double, Eigen::VectorXd>> past;
  Noise sensor_noise, tracker_noise;
};

Plant::Plant(const RobotParameters& robot, const PlantOptions& options)
    : impl_(std::make_unique<Impl>(robot, options)) {}
Plant::~Plant() = default;

int Plant::tendons() const { return impl_->m; }
const model::Body& Plant::body() const { return impl_->body; }

void Plant::SetTorque(const Eigen::Ref<const Eigen::VectorXd>& torque_Nm) {
  if (torque_Nm.size() != impl_->m) {
    throw std::invalid_argument(fmt::format("plant: {} torques for {} motors", torque_Nm.size(), impl_->m));
  }
  if (!torque_Nm.allFinite()) throw std::invalid_argument("plant: a torque is not finite");
  for (int j = 0; j < impl_->m; ++j) impl_->drive[j].SetTorque(ToSeconds(impl_->time_ns), torque_Nm[j]);
}

void Plant::Advance(TimeNs dt_ns) { impl_->Advance(dt_ns); }
TimeNs Plant::time_ns() const { return impl_->time_ns; }
const Eigen::VectorXd& Plant::q() const { return impl_->q; }
const Eigen::VectorXd& Plant::dq() const { return impl_->dq; }
const std::vector<TendonState>& Plant::tendon() const { return impl_->state; }
model::Pose Plant::TipPose() const { return impl_->body.TipPose(impl_->q); }
std::vector<TendonSensors> Plant::ReadSensors() { return impl_->ReadSensors(); }
TrackerReading Plant::ReadTracker() { return impl_->ReadTracker(); }

Plant::Counters Plant::counters() const {
  const auto c = impl_->integrator->counters();
  return {static_cast<std::uint64_t>(c.steps), static_cast<std::uint64_t>(c.derivatives), impl_->jacobians,
          static_cast<std::uint64_t>(c.newton)};
}

}  // namespace tendril::sim
