// The cuts of the chain, each driven by measured signals: the drivetrain's by its laws sample by sample, the
// body's by the integrator of body_motion.h. Knows nothing of files, noise or fits.
#include "tendril/sim/replay.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "actuation.h"
#include "begins_in_motion.h"
#include "body_motion.h"
#include "capstan_cache.h"
#include "drivetrain.h"
#include "laws.h"
#include "measured_tension.h"
#include "sampled.h"
#include "sensors.h"
#include "tendril/sim/effects.h"

namespace tendril::sim {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Longest step of the body's integrator: 0.01 mm at the tip for motions up to 10 Hz, and four times that.
constexpr double kLongestStep_s = 1.05e-3, kLongestCoarseStep_s = 2 * kLongestStep_s;
// Displacement over which the friction of pulleys builds up, at least, in what the body's integrator resolves
// of a tendon's displacement: over less its steps would not converge, and no sensor shows the difference.
constexpr double kLeastPresliding = 10;

RobotParameters Resolvable(RobotParameters robot) {
  if (!robot.actuation) return robot;
  const double least_m = kLeastPresliding * kBendTolerance_rad * robot.body.largest_hole_m();
  for (TendonDriveParameters& drive : robot.actuation->tendons) {
    double& presliding_m = drive.transmission.presliding_m;
    if (presliding_m > 0) presliding_m = std::max(presliding_m, least_m);
  }
  return robot;
}

/// Every n-th sample.
ReplaySignals EveryNth(const ReplaySignals& dense, Index every) {
  ReplaySignals thin = dense;
  thin.step_s *= static_cast<double>(every);
  const auto keep = [every](auto& rows) {
    if (rows.rows() > 0) rows = rows(Eigen::seq(Index{0}, rows.rows() - 1, every), Eigen::all).eval();
  };
  for (MatrixXd* rows :
       {&thin.torque_target_Nm, &thin.torque_actual_Nm, &thin.motor_angle_rad, &thin.motor_velocity_radps,
        &thin.motor_acceleration_radps2, &thin.tension_N, &thin.bending_rad}) {
    keep(*rows);
  }
  keep(thin.no_cell);
  return thin;
}

/// Rows at `samples` of a grid of which every n-th is known, linear between; held after the last.
MatrixXd Between(const MatrixXd& known, Index every, Index samples) {
  MatrixXd rows(samples, known.cols());
  for (Index i = 0; i < samples; ++i) {
    const Index k = i / every, next = std::min(k + 1, known.rows() - 1);
    const double share = static_cast<double>(i % every) / static_cast<double>(every);
    rows.row(i) = (1 - share) * known.row(k) + share * known.row(next);
  }
  return rows;
}

}  // namespace

struct Replay::Impl {
  explicit Impl(const RobotParameters& given)
      : robot(Resolvable(FoldEffects(given))),
        actuation(Actuation(robot, "a replay")),
        laws(PlantLaws::Of(robot)),
        sensor(actuation, laws.sensor),
        body(robot.body),
        n(body.dof()),
        m(body.tendons()) {
    for (int j = 0; j < m; ++j) {
      const auto& p = actuation.tendons[At(j)];
      drive.emplace_back(p, robot.RestTension_N(j),
                         CachedCapstanTable(p.transmission, TabulatedTo_N(robot), kReplayedCapstan),
                         laws.tendon[At(j)]);
      const auto& nominal = Actuation(given, "a replay").tendons[At(j)].load_cell;
      if (nominal.place == LoadCellPlace::kNone) {
        cell.push_back({1, 0});
      } else {
        cell.push_back({p.load_cell.gain_VpN / nominal.gain_VpN, nominal.offset_N});
      }
    }
  }
  static std::size_t At(int j) { return static_cast<std::size_t>(j); }

  // ---- signals ----

  /// A required signal: S x M, gaps bridged. Throws when it was not measured.
  MatrixXd Needed(const MatrixXd& signal, Index samples, const char* what) const {
    if (signal.cols() != m || signal.rows() != samples || samples == 0) {
      throw std::invalid_argument(fmt::format("replay: {} is {} x {}; needed {} x {}, a column a tendon",
                                              what, signal.rows(), signal.cols(), samples, m));
    }
    MatrixXd filled = signal;
    for (int j = 0; j < m; ++j) {
      if (!Bridge(filled.col(j))) {
        throw std::runtime_error(fmt::format("replay: {} of tendon {} is nowhere known", what, j + 1));
      }
    }
    return filled;
  }
  static double Step(const ReplaySignals& s) {
    if (!(s.step_s > 0)) {
      throw std::invalid_argument(
          fmt::format("replay: step of {} s between samples: accepted > 0", s.step_s));
    }
    return s.step_s;
  }
  /// Times of the S samples.
  static VectorXd TimesOf(const ReplaySignals& s, Index samples) {
    if (s.time_s.size() == 0) {
      const double step = Step(s);
      VectorXd time(samples);
      for (Index i = 0; i < samples; ++i) time[i] = static_cast<double>(i) * step;
      return time;
    }
    if (!s.at_rest || s.time_s.size() != samples) {
      throw std::invalid_argument(
          fmt::format("replay: {} times for {} samples; accepted: none, or one a sample at rest",
                      s.time_s.size(), samples));
    }
    return s.time_s;
  }

  /// Of samples at these times, equally spaced unless they are states at rest.
  static Grid GridOf(const ReplaySignals& s, const VectorXd& time_s) {
    return s.at_rest ? Grid(time_s) : Grid(s.step_s, time_s.size());
  }

  /// Actual motor motion, from the encoders' readings.
  struct Motors {
    MatrixXd angle, velocity;
  };
  Motors MotorsOf(const ReplaySignals& s) const {
    const Index samples = s.motor_angle_rad.rows();
    Motors motors{
        Needed(s.motor_angle_rad, samples, "motor angle"),
        s.at_rest ? MatrixXd::Zero(samples, m) : Needed(s.motor_velocity_radps, samples, "motor velocity")};
    for (int j = 0; j < m; ++j) {
      for (double& angle : motors.angle.col(j)) angle = sensor.Motor(j, angle);
    }
    return motors;
  }

  /// As recorded with the gain and offset of the robot before its effects, and back.
  double Read(int j, double tension_N, double time_s) const {
    const Cell& c = cell[At(j)];
    return c.gain * sensor.Shown(j, tension_N, time_s) - c.nominal_offset_N;
  }
  double Unread(int j, double reading_N, double time_s) const {
    const Cell& c = cell[At(j)];
    return std::max(0.0, sensor.Tension(j, (reading_N + c.nominal_offset_N) / c.gain, time_s));
  }

  // ---- cuts of one tendon at a time ----

  MatrixXd ActualTorque(const ReplaySignals& s) const {
    const double step = Step(s);
    const MatrixXd target = Needed(s.torque_target_Nm, s.torque_target_Nm.rows(), "target torque");
    const VectorXd time = TimesOf(s, target.rows());
    if (s.commands_a_sample < 1)
      throw std::invalid_argument(
          fmt::format("replay: {} commands a sample: accepted >= 1", s.commands_a_sample));
    // What was sent before the first sample is not known, however late it acts: a drive that reports its
    // torque has that one until the first target comes to act.
    const bool reported = s.torque_actual_Nm.cols() == m && s.torque_actual_Nm.rows() == target.rows();
    MatrixXd actual(target.rows(), m);
    for (int j = 0; j < m; ++j) {
      TorqueLoop loop = drive[At(j)].loop();
      if (reported && std::isfinite(s.torque_actual_Nm(0, j))) loop = loop.Holding(s.torque_actual_Nm(0, j));
      Index sent = 0;
      for (Index i = 0; i < target.rows(); ++i) {
        const double now = time[i];
        // Tolerates round-off of a thousandth of a step: a SYNC at a sample acts before it.
        for (; sent <= i * s.commands_a_sample; ++sent) {
          const Index row = sent / s.commands_a_sample, next = std::min(row + 1, i);
          const double share = static_cast<double>(sent % s.commands_a_sample) / s.commands_a_sample;
          const double acts = time[row] + share * (time[next] - time[row]) + s.command_delay_s;
          if (acts > now + 1e-3 * step) break;
          loop.Set(std::min(acts, now), target(row, j) + share * (target(next, j) - target(row, j)));
        }
        actual(i, j) = loop.At(now);
      }
    }
    return actual;
  }

  /// Motor-side tension S x M from the torque, and the robot-side one where the shortening is given.
  MatrixXd FromTorque(const ReplaySignals& s, const MatrixXd* shortening) const {
    const double step = Step(s);
    const Motors motors = MotorsOf(s);
    const Index samples = motors.angle.rows();
    const MatrixXd torque = Needed(s.torque_actual_Nm, samples, "actual torque");
    const MatrixXd acceleration = s.at_rest
                                      ? MatrixXd::Zero(samples, m)
                                      : Needed(s.motor_acceleration_radps2, samples, "motor acceleration");
    const VectorXd time = TimesOf(s, samples);
    MatrixXd tension(samples, m);
    VectorXd d = VectorXd::Zero(samples), rate = VectorXd::Zero(samples);
    for (int j = 0; j < m; ++j) {
      if (shortening) {
        d = shortening->col(j);
        if (!s.at_rest) Differentiate(d, step, rate);
      }
      Drivetrain line = drive[At(j)];
      for (Index i = 0; i < samples; ++i) {
        const double now = time[i];
        const DrivetrainMotion motion{motors.angle(i, j), motors.velocity(i, j), d[i], rate[i]};
        tension(i, j) = line.TensionFromTorque(now, motion, torque(i, j), acceleration(i, j));
        if (shortening) tension(i, j) = line.BaseTension(now, motion, tension(i, j));
        line.Commit(now, motion);
      }
    }
    return tension;
  }

  MatrixXd CellFromTorque(const ReplaySignals& s, const MatrixXd& shortening) const {
    const bool robot_side = s.load_cell == LoadCellPlace::kRobotSide;
    MatrixXd d;
    if (robot_side) d = Needed(shortening, s.motor_angle_rad.rows(), "shortening");
    return Readings(FromTorque(s, robot_side ? &d : nullptr), TimesOf(s, s.motor_angle_rad.rows()));
  }

  MatrixXd CellFromStretch(const ReplaySignals& s, const MatrixXd& shortening,
                           const VectorXd& zero_rad) const {
    const double step = Step(s);
    Motors motors = MotorsOf(s);
    if (zero_rad.size() > 0) motors.angle.rowwise() -= zero_rad.transpose();
    const Index samples = motors.angle.rows();
    const MatrixXd d = Needed(shortening, samples, "shortening");
    MatrixXd tension(samples, m);
    VectorXd rate = VectorXd::Zero(samples);
    const VectorXd time = TimesOf(s, samples);
    for (int j = 0; j < m; ++j) {
      if (!s.at_rest) Differentiate(d.col(j), step, rate);
      Drivetrain line = drive[At(j)];
      for (Index i = 0; i < samples; ++i) {
        const double now = time[i];
        const DrivetrainMotion motion{motors.angle(i, j), motors.velocity(i, j), d(i, j), rate[i]};
        tension(i, j) = line.TensionFromStretch(now, motion);
        if (s.load_cell == LoadCellPlace::kRobotSide) {
          tension(i, j) = line.BaseTension(now, motion, tension(i, j));
        }
        line.Commit(now, motion);
      }
    }
    return Readings(std::move(tension), time);
  }

  // A reading rises with the angle, linearly while the tendon is taut.
  VectorXd ZeroAtRest(const ReplaySignals& s, const MatrixXd& shortening, Index rest,
                      const VectorXd& reading) const {
    constexpr double kFirst_rad = 0.1, kMost_rad = 1e5, kExact_rad = 1e-9;
    const Motors motors = MotorsOf(s);
    const Index samples = motors.angle.rows();
    const MatrixXd d = Needed(shortening, samples, "shortening");
    rest = std::clamp<Index>(rest, 1, samples);
    VectorXd zero = VectorXd::Zero(m);
    for (int j = 0; j < m; ++j) {
      const double angle = motors.angle.col(j).head(rest).mean(), shortened = d.col(j).head(rest).mean();
      const auto reads = [&](double zero_rad) {
        const DrivetrainMotion motion{angle - zero_rad, 0, shortened, 0};
        double tension = drive[At(j)].TensionFromStretch(0, motion);
        if (s.load_cell == LoadCellPlace::kRobotSide) tension = drive[At(j)].BaseTension(0, motion, tension);
        return Read(j, tension, 0);
      };
      // Subtracted angles: one gives a lower reading, one a higher.
      double loose = kFirst_rad, tight = -kFirst_rad;
      while (reads(loose) > reading[j] && loose < kMost_rad) loose *= 2;
      while (reads(tight) < reading[j] && tight > -kMost_rad) tight *= 2;
      if (!(reads(loose) < reading[j] && reads(tight) > reading[j])) continue;
      while (loose - tight > kExact_rad) {
        const double middle = 0.5 * (loose + tight);
        (reads(middle) > reading[j] ? tight : loose) = middle;
      }
      zero[j] = 0.5 * (loose + tight);
    }
    return zero;
  }

  MatrixXd Readings(MatrixXd tension, const VectorXd& time) const {
    for (int j = 0; j < m; ++j) {
      for (Index i = 0; i < tension.rows(); ++i) {
        tension(i, j) = Read(j, tension(i, j), time[i]);
      }
    }
    return tension;
  }

  // ---- body ----
  /// With no longer steps than that.
  BodyMotion Body(const ReplaySignals& s, DrivenBy driven_by, double longest_s) const;
  BodyMotion CoarseBody(const ReplaySignals& s, DrivenBy driven_by) const;
  /// Integrates the body over the samples at `time`: q is 2N x S, tension M x S.
  void Move(const ReplaySignals& s, const VectorXd& time, double longest_s, TensionSource& source,
            MatrixXd& q, MatrixXd& tension) const;
  std::unique_ptr<TensionSource> Source(const ReplaySignals& s, DrivenBy driven_by) const;
  /// Source of one kind for all tendons.
  std::unique_ptr<TensionSource> SourceOfAll(const ReplaySignals& s, DrivenBy driven_by) const;
  MatrixXd Shortening(const ReplaySignals& s, const MatrixXd& q) const;
  /// `late`: the tracker's delay in samples.
  void Track(const MatrixXd& q, double late, BodyMotion& motion) const;

  struct Cell {
    double gain, nominal_offset_N;  // reading = gain * shown - nominal offset
  };

  RobotParameters robot;
  const ActuationParameters& actuation;
  PlantLaws laws;
  Sensors sensor;
  model::Body body;
  int n, m;
  std::vector<Drivetrain> drive;
  std::vector<Cell> cell;
};

std::unique_ptr<TensionSource> Replay::Impl::Source(const ReplaySignals& s, DrivenBy driven_by) const {
  if (driven_by != DrivenBy::kCell || s.no_cell.size() == 0) return SourceOfAll(s, driven_by);
  if (s.no_cell.rows() != s.tension_N.rows() || s.no_cell.cols() != m) {
    throw std::invalid_argument(fmt::format("replay: no_cell is {} x {}; accepted: {} x {}", s.no_cell.rows(),
                                            s.no_cell.cols(), s.tension_N.rows(), m));
  }
  if (s.motor_angle_rad.rows() != s.tension_N.rows()) {
    throw std::invalid_argument(fmt::format("replay: {} samples of tension, {} of motor angle",
                                            s.tension_N.rows(), s.motor_angle_rad.rows()));
  }
  return MixedTension(SourceOfAll(s, DrivenBy::kCell), SourceOfAll(s, DrivenBy::kMotor), s.no_cell,
                      GridOf(s, TimesOf(s, s.tension_N.rows())));
}

std::unique_ptr<TensionSource> Replay::Impl::SourceOfAll(const ReplaySignals& s, DrivenBy driven_by) const {
  const VectorXd time =
      TimesOf(s, driven_by == DrivenBy::kCell ? s.tension_N.rows() : s.motor_angle_rad.rows());
  const Grid grid = GridOf(s, time);
  MatrixXd tension;
  if (driven_by == DrivenBy::kCell) {
    tension = Needed(s.tension_N, s.tension_N.rows(), "tension");
    for (int j = 0; j < m; ++j) {
      for (Index i = 0; i < tension.rows(); ++i) tension(i, j) = Unread(j, tension(i, j), time[i]);
    }
    if (s.load_cell == LoadCellPlace::kRobotSide) {
      return GivenTension(std::move(tension), grid);
    }
    if (s.load_cell == LoadCellPlace::kNone) {
      throw std::invalid_argument("replay: no load cell; drive the body by torque or by motor");
    }
  }
  Motors motors = MotorsOf(s);
  if (driven_by == DrivenBy::kMotor) {
    return SpringTension(std::move(motors.angle), std::move(motors.velocity), drive, grid);
  }
  if (driven_by == DrivenBy::kTorque) tension = FromTorque(s, nullptr);
  const Index samples = tension.rows();
  if (motors.angle.rows() != samples) {
    throw std::invalid_argument(
        fmt::format("replay: {} samples of tension, {} of motor angle", samples, motors.angle.rows()));
  }
  PulleySignals signals{MatrixXd(samples, m), MatrixXd(samples, m), MatrixXd(samples, m),
                        MatrixXd(samples, m)};
  std::vector<double> presliding;
  for (int j = 0; j < m; ++j) {
    Drivetrain line = drive[At(j)];
    presliding.push_back(actuation.tendons[At(j)].transmission.presliding_m);
    for (Index i = 0; i < samples; ++i) {
      const DrivetrainMotion motion{motors.angle(i, j), motors.velocity(i, j), 0, 0};
      const double now = time[i];
      const Drivetrain::Spool spool = line.SpoolOf(now, motion);
      signals.spool_m(i, j) = spool.pull_m;
      signals.spool_rate_mps(i, j) = spool.rate_mps;
      if (!line.plain_spool()) line.Commit(now, motion);
      const PulleyMap map = line.Pulleys(tension(i, j));
      signals.middle_N(i, j) = map.middle_N;
      signals.half_N(i, j) = map.half_N;
    }
    // An unmeasured spool took up the body's shortening and the tendon's stretch.
    if (At(j) < s.no_motor.size() && s.no_motor[At(j)] != 0) {
      VectorXd rate(samples);
      signals.spool_m.col(j) = (tension.col(j).array() - tension(0, j)) / line.stiffness_Npm();
      if (s.at_rest) {
        rate.setZero();
      } else {
        Differentiate(signals.spool_m.col(j), Step(s), rate);
      }
      signals.spool_rate_mps.col(j) = rate;
    }
  }
  return PulleyTension(std::move(signals), presliding, s.no_motor, grid);
}

void Replay::Impl::Move(const ReplaySignals& s, const VectorXd& time, double longest_s, TensionSource& source,
                        MatrixXd& q, MatrixXd& tension) const {
  constexpr double kNear = 1.0 / 16;  // of a tension's range
  const int parts = std::max(1, static_cast<int>(std::ceil(s.step_s / longest_s)));
  BodyStepper stepper(body, laws.body, kNear * robot.limits.max_tension_base_N);
  const bool lets_go = !s.at_rest && BeginsInMotion(s, robot);
  if (!(lets_go ? stepper.LetGo(source, 0) : stepper.Settle(source, 0))) {
    throw std::runtime_error("replay: the body has no equilibrium under the first sample's tensions");
  }
  for (Index i = 0;; ++i) {
    q.col(i) = stepper.q();
    tension.col(i) = stepper.tension_N();
    if (i + 1 == time.size()) break;
    if (s.at_rest) {
      if (!stepper.Settle(source, time[i + 1])) {
        throw std::runtime_error(
            fmt::format("replay: the body has no equilibrium at {:.4f} s; its tensions are {} N", time[i + 1],
                        fmt::join(stepper.tension_N(), ", ")));
      }
      continue;
    }
    for (int part = 1; part <= parts; ++part) {
      const double to = (static_cast<double>(i) + static_cast<double>(part) / parts) * s.step_s;
      if (!stepper.StepTo(source, to)) {
        throw std::runtime_error(fmt::format(
            "replay: the body has neither motion nor equilibrium at {:.4f} s; its tensions are {} N", to,
            fmt::join(stepper.tension_N(), ", ")));
      }
    }
  }
}

BodyMotion Replay::Impl::Body(const ReplaySignals& s, DrivenBy driven_by, double longest_s) const {
  const double step = Step(s);
  const std::unique_ptr<TensionSource> source = Source(s, driven_by);
  const Index samples = driven_by == DrivenBy::kCell ? s.tension_N.rows() : s.motor_angle_rad.rows();
  MatrixXd q(n, samples), tension(m, samples);
  Move(s, TimesOf(s, samples), longest_s, *source, q, tension);

  BodyMotion motion;
  motion.tension_base_N = tension.transpose();
  motion.shortening_m = Shortening(s, q);
  const bool delayed = actuation.tracker && !s.at_rest;  // at rest, delay has no effect
  Track(q, delayed ? actuation.tracker->delay_s / step : 0, motion);
  return motion;
}

BodyMotion Replay::Impl::CoarseBody(const ReplaySignals& s, DrivenBy driven_by) const {
  const Index every = s.at_rest ? 1 : static_cast<Index>(kLongestCoarseStep_s / Step(s));
  if (every < 2) return Body(s, driven_by, kLongestCoarseStep_s);
  BodyMotion motion = Body(EveryNth(s, every), driven_by, kLongestCoarseStep_s);
  const Index samples = driven_by == DrivenBy::kCell ? s.tension_N.rows() : s.motor_angle_rad.rows();
  for (MatrixXd* rows : {&motion.q, &motion.tip_m, &motion.tip_rotation, &motion.bending_rad,
                         &motion.shortening_m, &motion.tension_base_N}) {
    *rows = Between(*rows, every, samples);
  }
  return motion;
}

// Where bending is measured, the shape is corrected by the difference, spread evenly over the section's units
// and interpolated linearly through gaps, so that the tendons see no jumps.
MatrixXd Replay::Impl::Shortening(const ReplaySignals& s, const MatrixXd& q) const {
  const Index samples = q.cols();
  const int sections = body.sections();
  MatrixXd off = MatrixXd::Zero(samples, 2 * sections);
  if (s.bending_rad.cols() > 0) {
    if (s.bending_rad.cols() != 2 * sections || s.bending_rad.rows() != samples) {
      throw std::invalid_argument(
          fmt::format("replay: bending is {} x {}; needed {} x {}, (us, vs) a section", s.bending_rad.rows(),
                      s.bending_rad.cols(), samples, 2 * sections));
    }
    for (int k = 0; k < sections; ++k) {
      for (int axis = 0; axis < 2; ++axis) {
        auto column = off.col(2 * k + axis);
        column = s.bending_rad.col(2 * k + axis);
        for (int i = body.first_unit(k); i < body.end_unit(k); ++i)
          column -= q.row(body.coordinate(i) + axis).transpose();
        if (!Bridge(column)) column.setZero();
        column /= body.end_unit(k) - body.first_unit(k);
      }
    }
  }
  MatrixXd shortening(samples, m);
  VectorXd shape(n), d(m);
  for (Index t = 0; t < samples; ++t) {
    shape = q.col(t);
    for (int k = 0; k < sections; ++k) {
      for (int i = body.first_unit(k); i < body.end_unit(k); ++i) {
        shape[body.coordinate(i)] += off(t, 2 * k);
        shape[body.coordinate(i) + 1] += off(t, 2 * k + 1);
      }
    }
    body.TendonShortening(shape, d);
    shortening.row(t) = d.transpose();
  }
  return shortening;
}

void Replay::Impl::Track(const MatrixXd& q, double late, BodyMotion& motion) const {
  const Index rows = q.cols();
  motion.q.resize(rows, n);
  motion.tip_m.resize(rows, 3);
  motion.tip_rotation.resize(rows, 3);
  motion.bending_rad.resize(rows, 2 * body.sections());
  VectorXd shape(n);
  for (Index i = 0; i < rows; ++i) {
    motion.q.row(i) = q.col(i).transpose();
    const double at = std::max(0.0, static_cast<double>(i) - late);
    const auto before = static_cast<Index>(at);
    shape = q.col(before);
    if (before < i) shape += (at - static_cast<double>(before)) * (q.col(before + 1) - q.col(before));
    const model::Pose pose = sensor.Tracked(body.TipPose(shape));
    motion.tip_m.row(i) = pose.p_WA.transpose();
    const Eigen::AngleAxisd rotation(pose.R_WA);
    motion.tip_rotation.row(i) = (rotation.angle() * rotation.axis()).transpose();
    for (int section = 0; section < body.sections(); ++section) {
      Eigen::Vector2d bend(0, 0);
      for (int u = body.first_unit(section); u < body.end_unit(section); ++u)
        bend += shape.segment<2>(body.coordinate(u));
      motion.bending_rad.row(i).segment<2>(2 * section) = sensor.Tracked(bend).transpose();
    }
  }
}

Replay::Replay(const RobotParameters& robot) : impl_(std::make_unique<Impl>(robot)) {}
Replay::~Replay() = default;
Replay::Replay(Replay&&) noexcept = default;
Replay& Replay::operator=(Replay&&) noexcept = default;

MatrixXd Replay::ActualTorque(const ReplaySignals& signals) const { return impl_->ActualTorque(signals); }
MatrixXd Replay::CellFromTorque(const ReplaySignals& signals, const MatrixXd& shortening_m) const {
  return impl_->CellFromTorque(signals, shortening_m);
}
MatrixXd Replay::CellFromStretch(const ReplaySignals& signals, const MatrixXd& shortening_m,
                                 const VectorXd& zero_rad) const {
  return impl_->CellFromStretch(signals, shortening_m, zero_rad);
}
VectorXd Replay::ZeroAtRest(const ReplaySignals& signals, const MatrixXd& shortening_m, int samples,
                            const VectorXd& reading_N) const {
  return impl_->ZeroAtRest(signals, shortening_m, samples, reading_N);
}
BodyMotion Replay::Body(const ReplaySignals& signals, DrivenBy driven_by, Steps steps) const {
  return steps == Steps::kFine ? impl_->Body(signals, driven_by, kLongestStep_s)
                               : impl_->CoarseBody(signals, driven_by);
}

}  // namespace tendril::sim
