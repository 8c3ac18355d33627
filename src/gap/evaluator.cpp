// Residuals at the cuts, and how much of them is not the model's fault.
#include "evaluator.h"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <stdexcept>

#include "parallel.h"
#include "tendril/model/body.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

constexpr double kWindow_s = 0.02;  // residuals are averaged over this: slower than the sensors' white noise
constexpr double kBendingWindow_s = 0.15;  // over which the tracker corrects the simulated bending
constexpr int kReadings = 4;               // alternative readings of the same log, see Prepare
// Nobody cares about less than this share of the floor, nor of the signal: simulations of one model agree no
// better.
constexpr double kFloorShare = 0.2, kSignalShare = 1e-3;
constexpr double kTransient = 4;  // times the white noise's variance, within one window
constexpr double kResolutionWindow_s = 0.25;
// What a model leaves unexplained stays alike over this time, or over so many states at rest.
constexpr double kCorrelation_s = 1.0, kCorrelationStates = 5;
// Motors all within this share of their range stand as before; with fewer such returns nothing is known of
// how a robot repeats.
constexpr double kReturnShare = 0.01;
constexpr int kLeastReturns = 20;

Eigen::Vector3d RotationVector(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd turn(R);
  return turn.angle() * turn.axis();
}

Eigen::Matrix3d Rotation(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  return angle > 0 ? Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix()
                   : Eigen::Matrix3d::Identity();
}

/// (u, v) of the bend that takes z to the frame's z axis; blind for twist.
Eigen::Vector2d BendOf(const Eigen::Matrix3d& R) {
  const Eigen::Vector3d z = R.col(2);
  const double side = std::hypot(z.x(), z.y());
  const double bend = std::atan2(side, z.z());
  return side > 1e-12 ? Eigen::Vector2d(bend / side * z.head<2>()) : Eigen::Vector2d(0, 0);
}

/// Bend of a single arc whose tip is at p.
Eigen::Vector2d BendOfTip(const Eigen::Vector3d& p) {
  const double side = std::hypot(p.x(), p.y());
  const double bend = 2 * std::atan2(side, p.z());
  return side > 1e-12 ? Eigen::Vector2d(bend / side * p.head<2>()) : Eigen::Vector2d(0, 0);
}

/// rms of white noise on a smooth signal, from third differences (robust against the motion itself).
double WhiteNoise(const Eigen::MatrixXd& signal, int column) {
  std::vector<double> differences;
  for (int i = 3; i < signal.rows(); ++i) {
    const double d =
        signal(i, column) - 3 * signal(i - 1, column) + 3 * signal(i - 2, column) - signal(i - 3, column);
    if (std::isfinite(d)) differences.push_back(std::abs(d));
  }
  if (differences.size() < 50) return 0;
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::nth_element(differences.begin(), middle, differences.end());
  // The median is no motion's; but of a coarsely rounded signal it is one of a few values, and the mean
  // square of what is of its size says more.
  const double most = 4 * *middle / 0.6745;
  double square = 0, count = 0;
  for (const double d : differences) {
    if (d <= most) square += d * d, count += 1;
  }
  return std::sqrt(square / count / 20);
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

int Windows(int samples, int width) { return samples / width; }

/// Means over windows of what is finite; NaN where nothing is.
Eigen::VectorXd Average(const Eigen::VectorXd& values, int width) {
  Eigen::VectorXd mean(Windows(static_cast<int>(values.size()), width));
  for (int w = 0; w < mean.size(); ++w) {
    double sum = 0;
    int count = 0;
    for (int i = w * width; i < (w + 1) * width; ++i) {
      if (!std::isfinite(values[i])) continue;
      sum += values[i];
      ++count;
    }
    mean[w] = count > 0 ? sum / count : std::nan("");
  }
  return mean;
}

int WindowSamples(const PreparedRun& run, const Channel& channel) {
  if (channel.quantity == Quantity::kTorque) return 1;
  return std::max(1, static_cast<int>(std::lround(kWindow_s / run.signals.step_s)));
}

/// The tracker's readings in the base's frame.
void Turn(const TrackerFrame& frame, PreparedRun& run) {
  for (Eigen::Index k = 0; k < run.tip_m.rows(); ++k)
    run.tip_m.row(k) = (frame.turn.transpose() * (run.tip_m.row(k).transpose() - frame.offset_m)).transpose();
  for (auto& R : run.tip_R) R = frame.turn.transpose() * R;
}

std::optional<EffectSetting> Setting(const RobotParameters& robot, std::string_view name) {
  for (const auto& effect : robot.effects) {
    if (effect.name == name) return effect;
  }
  return std::nullopt;
}

}  // namespace

struct Evaluator::Replayed {
  Eigen::MatrixXd torque_Nm, from_torque_N, from_stretch_N;
  sim::BodyMotion motion;
};

Evaluator::Evaluator(const DataSet& set, const Options& options) : nominal_(set.robot) {
  nominal_.effects = set.robot.effects;
  if (!nominal_.actuation) {
    throw std::runtime_error(fmt::format(
        "robot '{}' has no actuation; accepted: a robot file with motors, tendons and sensors; use the "
        "file that the robot was controlled with",
        nominal_.name));
  }
  const int tendons = nominal_.body.tendons();
  runs_.resize(set.runs.size());
  ParallelFor(static_cast<int>(set.runs.size()), options.threads,
              [&](int i) { runs_[i] = Prepare(set.runs[i], nominal_, 0); });

  // What all runs together can be compared on.
  const auto every = [&](auto&& test) { return std::all_of(runs_.begin(), runs_.end(), test); };
  const auto any = [&](auto&& test) { return std::any_of(runs_.begin(), runs_.end(), test); };
  const bool motor = every([](const PreparedRun& r) { return r.signals.motor_angle_rad.cols() > 0; });
  const auto torque_of = [](const PreparedRun& r) {
    return r.signals.torque_actual_Nm.cols() > 0 && r.signals.torque_actual_Nm.allFinite();
  };
  const auto target_of = [](const PreparedRun& r) {
    return r.signals.torque_target_Nm.cols() > 0 && r.signals.torque_target_Nm.allFinite();
  };
  const auto cell_of = [](const PreparedRun& r) {
    return r.signals.load_cell != LoadCellPlace::kNone && r.signals.tension_N.cols() > 0;
  };
  const bool torque = every(torque_of), target = every(target_of), cell = every(cell_of);
  const bool tracker = any([](const PreparedRun& r) { return r.tracked(); });
  if (!motor) {
    throw std::runtime_error(
        "no motor positions in (some of) the logs; accepted: motor_position_rad of every tendon in every "
        "run; without "
        "them neither friction's direction nor the tendons' stretch is known");
  }
  available_ = (torque && target ? kC1 : 0u) | (torque && cell ? kC2 : 0u) | (cell ? kC3 : 0u) |
               (tracker ? kBody : 0u);
  driven_by_ = cell     ? sim::Replay::DrivenBy::kCell
               : torque ? sim::Replay::DrivenBy::kTorque
                        : sim::Replay::DrivenBy::kMotor;
  if (available_ == 0) {
    throw std::runtime_error(
        "nothing to compare: the logs have neither torque targets and actual torques, nor tensions, nor a "
        "tip pose; "
        "accepted: at least one of them beside the motor positions");
  }
  if (!target || !torque)
    degradations_.push_back("no target or actual torque: the drives' current loop (C1) is not seen");
  if (!cell) {
    degradations_.push_back(torque ? "no load cell: tensions are taken from the motors' torque, so "
                                     "drivetrain, pulleys and body (C2 to C5) "
                                     "cannot be told apart by place, only by cause"
                                   : "no load cell and no torque: the body is driven by motor positions "
                                     "alone; tensions are not known, so "
                                     "drive and friction effects are not seen");
  }
  if (cell && !torque) degradations_.push_back("no actual torque: motors and gears (C2) are not seen");
  if (!tracker) {
    degradations_.push_back(
        "no tracker: shape and motion (C4, C5) are not seen; body effects show only through tendon "
        "displacement (C3) and "
        "cannot be told from tendon effects by place");
  }

  // Where a cell says nothing its tendon takes the tension that its torque makes.
  if (cell) {
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      PreparedRun& run = runs_[i];
      for (const CellHole& hole : run.cell_holes) {
        const bool whole = hole.to - hole.from == run.samples();
        if (whole && !torque) {
          throw RunError(i, fmt::format("{}: no tension of tendon {} and no torque to take it from", run.name,
                                        hole.tendon + 1));
        }
        degradations_.push_back(
            whole
                ? fmt::format("{}: no load cell on tendon {}: its tension is taken from the motor's torque",
                              run.name, hole.tendon + 1)
                : fmt::format("{}: the load cell on tendon {} says nothing for {:.2g} s from {:.4g} s on: {}",
                              run.name, hole.tendon + 1, (hole.to - hole.from) * run.signals.step_s,
                              hole.from * run.signals.step_s,
                              torque ? "its tension is taken from the motor's torque"
                                     : "bridged by a straight line"));
      }
      if (!torque) run.cell_holes.clear();
      stood_in_ = stood_in_ || !run.cell_holes.empty();
      run.signals = StoodIn(nominal_, run);
    }
  }

  for (int j = 0; j < tendons; ++j) {
    if (has(kC1))
      channels_.push_back(
          {sim::Cut::kCurrentLoop, Quantity::kTorque, j, fmt::format("torque {}", j + 1), "N·m"});
  }
  for (int j = 0; j < tendons; ++j) {
    if (has(kC2))
      channels_.push_back(
          {sim::Cut::kDrivetrain, Quantity::kTension, j, fmt::format("tension {} from torque", j + 1), "N"});
  }
  for (int j = 0; j < tendons; ++j) {
    if (has(kC3))
      channels_.push_back(
          {sim::Cut::kTendon, Quantity::kTension, j, fmt::format("tension {} from stretch", j + 1), "N"});
  }
  const bool turned = any([](const PreparedRun& r) { return !r.tip_R.empty(); });
  if (tracker && !turned)
    degradations_.push_back("the tracker gives no orientation: shape from the tip's position alone");
  for (int i = 0; i < 3; ++i) {
    if (has(kBody))
      channels_.push_back(
          {sim::Cut::kShape, Quantity::kTipPosition, i, fmt::format("tip {}", "xyz"[i]), "m"});
  }
  for (int i = 0; i < 3; ++i) {
    if (has(kBody) && turned)
      channels_.push_back(
          {sim::Cut::kShape, Quantity::kTipDirection, i, fmt::format("tip rotation {}", "xyz"[i]), "rad"});
  }

  nominal_motion_.resize(runs_.size());
  nominal_residuals_.resize(runs_.size());
  std::vector<std::string> trouble(runs_.size());
  ParallelFor(static_cast<int>(runs_.size()), options.threads, [&](int i) {
    try {
      nominal_motion_[i] = sim::Replay(nominal_).Body(runs_[i].signals, driven_by_, 1);
    } catch (const std::runtime_error& error) {
      trouble[i] = error.what();
      return;
    }
  });
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    if (!trouble[i].empty()) throw RunError(i, fmt::format("{}: {}", runs_[i].name, trouble[i]));
  }
  if (set.fit_frame && tracker) FindFrame();
  ParallelFor(static_cast<int>(runs_.size()), options.threads, [&](int i) {
    nominal_motion_[i].shortening_m = MeasuredShortening(runs_[i], nominal_, nominal_motion_[i]);
  });
  if (any([](const PreparedRun& r) { return r.signals.at_rest; })) {
    degradations_.push_back(fmt::format(
        "rows are more than {} s apart: the body is taken as at rest at each row, friction as slid straight "
        "from row to row; motion (C5), damping and delays are not seen",
        kQuasiStatic_s));
  }
  FindFloors(set, options);
}

double Evaluator::Correlated(int run, int channel) const {
  return runs_[run].signals.at_rest ? kCorrelationStates
                                    : std::max(1.0, kCorrelation_s / window_s(run, channel));
}

// The rigid motion that takes the nominal robot's tips to the measured ones, in the least squares of
// distances whose largest count less (Kabsch, reweighted): a robot that differs is not always off by the
// same.
void Evaluator::FindFrame() {
  constexpr int kPasses = 20;
  constexpr double kLeastSpread =
      0.02;  // of the tips across, of their spread along: else a turn is not known
  std::vector<Eigen::Vector3d> simulated, measured;
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    const PreparedRun& run = runs_[i];
    if (!run.tracked()) continue;
    const int last = static_cast<int>(nominal_motion_[i].tip_m.rows()) - 1;
    for (int k = 0; k < run.tracker_s.size(); ++k) {
      const int at =
          std::clamp(static_cast<int>(std::lround(run.tracker_s[k] / run.signals.step_s)), 0, last);
      simulated.emplace_back(nominal_motion_[i].tip_m.row(at).transpose());
      measured.emplace_back(run.tip_m.row(k).transpose());
    }
  }
  TrackerFrame frame;
  std::vector<double> weight(simulated.size(), 1.0);
  for (int pass = 0; pass < kPasses; ++pass) {
    double total = 0;
    Eigen::Vector3d from(0, 0, 0), to(0, 0, 0);
    for (std::size_t k = 0; k < simulated.size(); ++k) {
      total += weight[k];
      from += weight[k] * simulated[k];
      to += weight[k] * measured[k];
    }
    from /= total;
    to /= total;
    Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
    for (std::size_t k = 0; k < simulated.size(); ++k)
      cross += weight[k] * (measured[k] - to) * (simulated[k] - from).transpose();
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
    if (!(svd.singularValues()[1] > kLeastSpread * svd.singularValues()[0])) {
      throw std::runtime_error(
          "tracker_frame: fit: the tips of these runs lie on a line, so that the tracker's frame cannot be "
          "fitted; accepted: bends in several directions; add runs or give the frame");
    }
    Eigen::Vector3d proper(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant() > 0 ? 1 : -1);
    frame.turn = svd.matrixU() * proper.asDiagonal() * svd.matrixV().transpose();
    frame.offset_m = to - frame.turn * from;
    std::vector<double> distance;
    for (std::size_t k = 0; k < simulated.size(); ++k)
      distance.push_back((measured[k] - frame.turn * simulated[k] - frame.offset_m).norm());
    const double usual = std::max(Median(distance), 1e-9);
    for (std::size_t k = 0; k < simulated.size(); ++k) weight[k] = 1 / std::max(1.0, distance[k] / usual);
  }
  frame_ = frame;
  for (PreparedRun& run : runs_) Turn(frame, run);
  const Eigen::Vector3d turn = RotationVector(frame.turn);
  degradations_.push_back(
      fmt::format("the tracker's frame is not known: fitted to the nominal robot (rotation vector {:.4f}, "
                  "{:.4f}, {:.4f} rad, "
                  "offset {:.2f}, {:.2f}, {:.2f} mm) and free within 0.3 rad and 60 mm beside every cause; "
                  "what a wrong frame "
                  "looks like (a tilt without weight, an offset) cannot be told",
                  turn.x(), turn.y(), turn.z(), 1e3 * frame.offset_m.x(), 1e3 * frame.offset_m.y(),
                  1e3 * frame.offset_m.z()));
}

double Evaluator::Unrepeated(int channel, int& returns) const {
  // States of all runs one after the other.
  struct State {
    int run, row;
  };
  std::vector<State> states;
  double range = 0;
  for (int j = 0; j < nominal_.body.tendons(); ++j) {
    double least = INFINITY, most = -INFINITY;
    for (const PreparedRun& run : runs_) {
      if (!run.signals.at_rest) continue;
      least = std::min(least, run.signals.motor_angle_rad.col(j).minCoeff());
      most = std::max(most, run.signals.motor_angle_rad.col(j).maxCoeff());
    }
    range = std::max(range, most - least);
  }
  for (int i = 0; i < static_cast<int>(runs_.size()); ++i) {
    if (!runs_[i].signals.at_rest) continue;
    for (int w = 0; w < nominal_residuals_[i][channel].size(); ++w) {
      if (std::isfinite(variance_[i][channel][w])) states.push_back({i, w});
    }
  }
  double sum = 0;
  returns = 0;
  for (std::size_t b = 1; b < states.size(); ++b) {
    const auto at = runs_[states[b].run].signals.motor_angle_rad.row(states[b].row);
    for (std::size_t a = 0; a < b; ++a) {
      // Not having moved is no return.
      if (states[a].run == states[b].run && states[b].row - states[a].row < 3) continue;
      const auto was = runs_[states[a].run].signals.motor_angle_rad.row(states[a].row);
      if ((at - was).cwiseAbs().maxCoeff() > kReturnShare * range) continue;
      const auto &ra = nominal_residuals_[states[a].run][channel],
                 &rb = nominal_residuals_[states[b].run][channel];
      const auto &va = variance_[states[a].run][channel], &vb = variance_[states[b].run][channel];
      sum += std::pow(ra[states[a].row] - rb[states[b].row], 2) / (va[states[a].row] + vb[states[b].row]);
      ++returns;
    }
  }
  return returns > 0 ? sum / returns : 0;
}

double Evaluator::window_s(int run, int channel) const {
  return WindowSamples(runs_[run], channels_[channel]) * runs_[run].signals.step_s;
}

// Shortening of the tendons in the body. The tracker's bend replaces the simulated one at low frequency; the
// simulation keeps what is faster than the tracker's noise allows.
Eigen::MatrixXd Evaluator::MeasuredShortening(const PreparedRun& run, const RobotParameters& robot,
                                              const sim::BodyMotion& motion) const {
  const bool turned = !run.tip_R.empty();
  const int seen = static_cast<int>(run.tracker_s.size());
  if (!run.tracked() || (!turned && nominal_.body.sections.size() > 1)) return motion.shortening_m;
  const RobotParameters folded = sim::FoldEffects(robot);
  Eigen::Matrix3d tracker_R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d tracker_p(0, 0, 0);
  if (const auto s = Setting(robot, "tracker_rotation")) {
    const auto v = sim::ValuesOf(*s);
    tracker_R = Rotation({v[0], v[1], v[2]});
  }
  if (const auto s = Setting(robot, "tracker_offset")) {
    const auto v = sim::ValuesOf(*s);
    tracker_p = {v[0], v[1], v[2]};
  }
  const double delay_s =
      folded.actuation->tracker && !run.signals.at_rest ? folded.actuation->tracker->delay_s : 0;

  const int samples = run.samples();
  const double step_s = run.signals.step_s;
  // Both as reported: the tracker's delay is in the simulated pose as well.
  Eigen::MatrixXd difference(seen, 2);
  for (int k = 0; k < seen; ++k) {
    const int at = std::clamp(static_cast<int>(std::lround(run.tracker_s[k] / step_s)), 0, samples - 1);
    const Eigen::Vector3d tip = motion.tip_m.row(at).transpose();
    const Eigen::Vector3d measured_tip = run.tip_m.row(k).transpose();
    if (turned) {
      const Eigen::Matrix3d simulated = Rotation(motion.tip_rotation.row(at).transpose());
      difference.row(k) =
          BendOf(tracker_R.transpose() * run.tip_R[k]) - BendOf(tracker_R.transpose() * simulated);
    } else {
      difference.row(k) = BendOfTip(tracker_R.transpose() * (measured_tip - tracker_p)) -
                          BendOfTip(tracker_R.transpose() * (tip - tracker_p));
    }
  }
  // Mean over a window, then linear onto the grid.
  Eigen::MatrixXd smooth(seen, 2);
  int low = 0, high = 0;
  Eigen::RowVector2d sum(0, 0);
  for (int k = 0; k < seen; ++k) {
    while (high < seen && run.tracker_s[high] <= run.tracker_s[k] + 0.5 * kBendingWindow_s)
      sum += difference.row(high++);
    while (run.tracker_s[low] < run.tracker_s[k] - 0.5 * kBendingWindow_s) sum -= difference.row(low++);
    smooth.row(k) = sum / (high - low);
  }
  const model::Body body(folded.body);
  const int units = body.units();
  Eigen::MatrixXd shortening(samples, body.tendons());
  Eigen::VectorXd q(2 * units), d(body.tendons());
  int at = 0;
  for (int i = 0; i < samples; ++i) {
    const double seen_at = i * step_s + delay_s;
    while (at + 2 < seen && run.tracker_s[at + 1] < seen_at) ++at;
    const double span = run.tracker_s[at + 1] - run.tracker_s[at];
    const double share = span > 0 ? std::clamp((seen_at - run.tracker_s[at]) / span, 0.0, 1.0) : 0;
    const Eigen::RowVector2d delta = (smooth.row(at) + share * (smooth.row(at + 1) - smooth.row(at))) / units;
    q = motion.q.row(i).transpose();
    for (int u = 0; u < units; ++u) q.segment<2>(2 * u) += delta.transpose();
    body.TendonShortening(q, d);
    shortening.row(i) = d.transpose();
  }
  return shortening;
}

// With the tensions that torque makes where cells say nothing: by the laws of this robot, not of the nominal
// one, or what changes torque into tension would be an error of the body.
sim::ReplaySignals Evaluator::StoodIn(const RobotParameters& robot, const PreparedRun& run) const {
  sim::ReplaySignals signals = run.signals;
  if (run.cell_holes.empty()) return signals;
  const auto fill = [&](auto&& with) {
    for (const CellHole& hole : run.cell_holes)
      signals.tension_N.col(hole.tendon).segment(hole.from, hole.to - hole.from) = with(hole);
  };
  fill([&](const CellHole& hole) { return Eigen::VectorXd::Zero(hole.to - hole.from).eval(); });
  const Eigen::MatrixXd still = Eigen::MatrixXd::Zero(run.samples(), signals.tension_N.cols());
  const Eigen::MatrixXd made = sim::Replay(robot).CellFromTorque(signals, still);
  fill([&](const CellHole& hole) {
    return made.col(hole.tendon).segment(hole.from, hole.to - hole.from).eval();
  });
  return signals;
}

Evaluator::Replayed Evaluator::ReplayRun(const RobotParameters& robot, const PreparedRun& run, unsigned cuts,
                                         const sim::BodyMotion* known_motion) const {
  const sim::Replay replay(robot);
  Replayed out;
  // Tracker effects change the shape that is read from it.
  const bool tracker = Setting(robot, "tracker_rotation") || Setting(robot, "tracker_delay") ||
                       Setting(robot, "tracker_offset");
  const bool simulate = (cuts & kBody) != 0 || known_motion == nullptr;
  if (simulate) {
    out.motion = replay.Body(run.cell_holes.empty() ? run.signals : StoodIn(robot, run), driven_by_, 1);
    if ((cuts & (kC2 | kC3)) || tracker) out.motion.shortening_m = MeasuredShortening(run, robot, out.motion);
  }
  const Eigen::MatrixXd& shortening = simulate ? out.motion.shortening_m : known_motion->shortening_m;
  if ((cuts & kC1) && has(kC1)) out.torque_Nm = replay.ActualTorque(run.signals);
  if ((cuts & kC2) && has(kC2)) out.from_torque_N = replay.CellFromTorque(run.signals, shortening);
  if ((cuts & kC3) && has(kC3)) out.from_stretch_N = replay.CellFromStretch(run.signals, shortening);
  return out;
}

std::vector<Eigen::VectorXd> Evaluator::ResidualsOf(const Replayed& replayed, const PreparedRun& run,
                                                    unsigned cuts,
                                                    std::vector<Eigen::VectorXd>* scatter) const {
  std::vector<Eigen::VectorXd> residuals(channels_.size());
  if (scatter) scatter->assign(channels_.size(), {});
  const int samples = run.samples();
  Eigen::MatrixXd tip;
  if ((cuts & kBody) && has(kBody) && run.tracked()) {
    const double stride_s = run.signals.step_s;
    const int rows = static_cast<int>(replayed.motion.tip_m.rows());
    tip = Eigen::MatrixXd::Constant(samples, 6, NAN);
    for (int k = 0; k < run.tracker_s.size(); ++k) {
      const double row = std::clamp(run.tracker_s[k] / stride_s, 0.0, rows - 1.0);
      const int r0 = std::min(static_cast<int>(row), rows - 1), r1 = std::min(r0 + 1, rows - 1);
      const double share = row - r0;
      const int at =
          std::clamp(static_cast<int>(std::lround(run.tracker_s[k] / run.signals.step_s)), 0, samples - 1);
      tip.row(at).head<3>() = run.tip_m.row(k) - replayed.motion.tip_m.row(r0) -
                              share * (replayed.motion.tip_m.row(r1) - replayed.motion.tip_m.row(r0));
      if (run.tip_R.empty()) continue;
      const Eigen::Vector3d turn =
          replayed.motion.tip_rotation.row(r0) +
          share * (replayed.motion.tip_rotation.row(r1) - replayed.motion.tip_rotation.row(r0));
      tip.row(at).tail<3>() = RotationVector(run.tip_R[k] * Rotation(turn).transpose());
    }
  }
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    const Channel& channel = channels_[c];
    Eigen::VectorXd all;
    const auto j = channel.index;
    if (channel.cut == sim::Cut::kCurrentLoop && replayed.torque_Nm.cols() > 0) {
      all = run.signals.torque_actual_Nm.col(j) - replayed.torque_Nm.col(j);
    } else if (channel.cut == sim::Cut::kDrivetrain && replayed.from_torque_N.cols() > 0) {
      all = run.cell_N.col(j) - replayed.from_torque_N.col(j);
      for (int i = 0; i < samples; ++i) {
        if (!run.sliding(i, j)) all[i] = std::nan("");
      }
    } else if (channel.cut == sim::Cut::kTendon && replayed.from_stretch_N.cols() > 0) {
      all = run.cell_N.col(j) - replayed.from_stretch_N.col(j);
    } else if (channel.cut == sim::Cut::kShape && tip.rows() > 0) {
      all = tip.col(channel.quantity == Quantity::kTipPosition ? j : 3 + j);
    } else {
      continue;
    }
    for (int i = 0; i < samples; ++i) {
      if (!run.valid[i]) all[i] = NAN;
    }
    const int width = WindowSamples(run, channel);
    residuals[c] = Average(all, width);
    if (scatter) {
      const Eigen::VectorXd square = Average(all.array().square(), width);
      (*scatter)[c] = (square.array() - residuals[c].array().square()).max(0.0);
    }
  }
  return residuals;
}

Residuals Evaluator::At(const RobotParameters& robot, unsigned cuts, const std::vector<int>& only) const {
  Residuals residuals(runs_.size());
  const auto one = [&](int i) {
    const Replayed replayed = ReplayRun(robot, runs_[i], cuts, &nominal_motion_[i]);
    residuals[i] = ResidualsOf(replayed, runs_[i], cuts);
    for (std::size_t c = 0; c < channels_.size(); ++c) {
      auto& r = residuals[i][c];
      if (r.size() == 0 || variance_.empty()) continue;
      if (!before_.empty()) r -= before_[i][c];
      const auto& variance = variance_[i][c];
      for (int w = 0; w < r.size(); ++w) {
        if (!std::isfinite(variance[w])) r[w] = 0;
        if (std::isfinite(variance[w]) && !std::isfinite(r[w])) {
          throw std::runtime_error("simulation without a result in " + channels_[c].name);
        }
      }
    }
  };
  if (only.empty()) {
    for (int i = 0; i < static_cast<int>(runs_.size()); ++i) one(i);
  } else {
    for (const int i : only) one(i);
  }
  return residuals;
}

double Evaluator::Spread(const Channel& channel) const {
  double square = 0, signal_sum = 0, signals = 0;
  for (const auto& run : runs_) {
    const auto add = [&](const Eigen::MatrixXd& signal) {
      for (int i = 0; i < signal.rows(); ++i) {
        const double value = signal(i, channel.index);
        if (!std::isfinite(value)) continue;
        square += value * value, signal_sum += value, signals += 1;
      }
    };
    if (channel.quantity == Quantity::kTension) add(run.cell_N);
    if (channel.quantity == Quantity::kTipPosition) add(run.tip_m);
    if (channel.quantity == Quantity::kTipDirection && !run.tip_R.empty()) {
      Eigen::MatrixXd turns(static_cast<int>(run.tip_R.size()), 3);
      for (int k = 0; k < turns.rows(); ++k) turns.row(k) = RotationVector(run.tip_R[k]);
      add(turns);
    }
  }
  return signals > 0 ? std::sqrt(std::max(0.0, square / signals - std::pow(signal_sum / signals, 2))) : 0;
}

// What the nominal robot leaves of a run less what it left of the same commands before: errors of the model
// that were there before cancel, window by window, and the noise of both runs remains. A model that was off
// by a tenth of the motion then is taken to be off by a tenth of the change now: that is in the noise.
void Evaluator::TakeDifferences() {
  std::map<std::string, std::size_t> by_name;
  for (std::size_t i = 0; i < runs_.size(); ++i) by_name[runs_[i].name] = i;
  std::vector<char> is_before(runs_.size(), 0);
  std::map<std::pair<sim::Cut, Quantity>, std::pair<double, double>> wrong;  // squares: left before, measured
  int compared = 0;
  for (const auto& run : runs_) {
    if (run.before.empty()) continue;
    if (by_name.contains(run.before)) is_before[by_name[run.before]] = 1;
    ++compared;
  }
  if (compared == 0) return;
  before_.resize(runs_.size());
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    if (is_before[i]) continue;
    const auto partner = by_name.find(runs_[i].before);
    if (partner == by_name.end()) {
      throw RunError(i, fmt::format("{}: {}", runs_[i].name,
                                    runs_[i].before.empty() ? "no run from before, which others have"
                                                            : "its run from before is left out"));
    }
    const std::size_t k = partner->second;
    const double step = runs_[i].signals.step_s, its = runs_[k].signals.step_s;
    if (runs_[i].signals.at_rest != runs_[k].signals.at_rest || std::abs(step - its) > 0.01 * step) {
      throw RunError(
          i, fmt::format("{}: a sample every {:.4g} s, and every {:.4g} s before; accepted: runs of the "
                         "same commands, recorded alike",
                         runs_[i].name, step, its));
    }
    before_[i].resize(channels_.size());
    for (std::size_t c = 0; c < channels_.size(); ++c) {
      auto &r = nominal_residuals_[i][c], &v = variance_[i][c];
      const auto &r0 = nominal_residuals_[k][c], &v0 = variance_[k][c];
      before_[i][c] = Eigen::VectorXd::Zero(r.size());
      for (Eigen::Index w = 0; w < r.size(); ++w) {
        v[w] = w < v0.size() ? v[w] + v0[w] : std::numeric_limits<double>::infinity();
        if (!std::isfinite(v[w])) {
          r[w] = 0;
          continue;
        }
        before_[i][c][w] = r0[w];
        r[w] -= r0[w];
      }
      white_[i][c] += white_[k][c];
    }
  }
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    auto& [left, measured] = wrong[{channels_[c].cut, channels_[c].quantity}];
    double square = 0, count = 0;
    for (std::size_t k = 0; k < runs_.size(); ++k) {
      for (Eigen::Index w = 0; is_before[k] && w < nominal_residuals_[k][c].size(); ++w) {
        if (!std::isfinite(variance_[k][c][w])) continue;
        square += std::pow(nominal_residuals_[k][c][w], 2) - variance_[k][c][w];
        count += 1;
      }
    }
    left += count > 0 ? std::max(0.0, square / count) : 0;
    measured += std::pow(Spread(channels_[c]), 2);
  }
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    const auto& [left, measured] = wrong[{channels_[c].cut, channels_[c].quantity}];
    if (!(measured > 0)) continue;
    wrong_before_ = std::max(wrong_before_, std::sqrt(left / measured));
  }
  // Where and whether something changed is then told by the noise alone, and a cause by nothing.
  for (std::size_t c = 0; !useless() && c < channels_.size(); ++c) {
    const auto& [left, measured] = wrong[{channels_[c].cut, channels_[c].quantity}];
    if (!(measured > 0)) continue;
    double change = 0, count = 0;
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      for (Eigen::Index w = 0; !is_before[i] && w < nominal_residuals_[i][c].size(); ++w) {
        if (!std::isfinite(variance_[i][c][w])) continue;
        change += std::pow(nominal_residuals_[i][c][w], 2);
        count += 1;
      }
    }
    if (count == 0) continue;
    const double square = left / measured * change / count;
    channels_[c].distrust = std::sqrt(square);
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      if (!is_before[i]) variance_[i][c].array() += square;
    }
  }
  const auto keep = [&](auto& all) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < is_before.size(); ++i) {
      if (is_before[i]) continue;
      if (kept != i) all[kept] = std::move(all[i]);
      ++kept;
    }
    all.resize(kept);
  };
  keep(runs_);
  keep(nominal_motion_);
  keep(nominal_residuals_);
  keep(variance_);
  keep(white_);
  keep(before_);
  degradations_.push_back(
      fmt::format("compared with runs of the same commands from before: the diagnosis is of what changed "
                  "since; what the model "
                  "got wrong then (up to {:.0f} % of what was measured) is taken off, and it is trusted no "
                  "better about the change",
                  100 * wrong_before_));
}

void Evaluator::FindFloors(const DataSet& set, const Options& options) {
  int runs = static_cast<int>(runs_.size());
  const int channels = static_cast<int>(channels_.size());

  // White noise of one sample, from the measured signals themselves.
  for (auto& channel : channels_) {
    std::vector<double> noise;
    for (const auto& run : runs_) {
      if (run.signals.at_rest) continue;  // from one state to the next is no noise
      switch (channel.quantity) {
        case Quantity::kTorque:
          noise.push_back(WhiteNoise(run.signals.torque_actual_Nm, channel.index));
          break;
        case Quantity::kTension:
          noise.push_back(WhiteNoise(run.cell_N, channel.index));
          break;
        case Quantity::kTipPosition:
          if (run.tip_m.rows() > 0) noise.push_back(WhiteNoise(run.tip_m, channel.index));
          break;
        case Quantity::kTipDirection: {
          if (run.tip_R.empty()) break;
          Eigen::MatrixXd turn(static_cast<int>(run.tip_R.size()), 3);
          for (int k = 0; k < turn.rows(); ++k) {
            // Against the first orientation, in the tip's own axes, where no turn is near pi.
            turn.row(k) = RotationVector(run.tip_R[0].transpose() * run.tip_R[k]);
          }
          noise.push_back(WhiteNoise(turn, channel.index));
          break;
        }
      }
    }
    const auto& p =
        nominal_.actuation
            ->tendons[channel.quantity == Quantity::kTorque || channel.quantity == Quantity::kTension
                          ? channel.index
                          : 0];
    double least = 0;  // a sensor's resolution is a floor even where it shows no noise
    if (channel.quantity == Quantity::kTorque) least = 1e-3 * p.drive.rated_torque_Nm / std::sqrt(12.0);
    if (channel.quantity == Quantity::kTension && p.load_cell.gain_VpN > 0)
      least = p.load_cell.resolution_V / p.load_cell.gain_VpN / std::sqrt(12.0);
    const auto& tracker = nominal_.actuation->tracker;
    if (channel.quantity == Quantity::kTipPosition)
      least = std::max(1e-6, noise.empty() && tracker ? tracker->position_noise_m : 0);
    if (channel.quantity == Quantity::kTipDirection)
      least = std::max(1e-5, noise.empty() && tracker ? tracker->orientation_noise_rad : 0);
    channel.white = std::max(least, Median(noise));
  }

  // The nominal residuals, and how they scatter over alternative readings of the same logs.
  std::vector<Residuals> readings(kReadings, Residuals(runs));
  Residuals within(runs);
  ParallelFor(runs * (kReadings + 1), options.threads, [&](int task) {
    const int i = task % runs, k = task / runs - 1;
    if (k < 0) {
      nominal_residuals_[i] =
          ResidualsOf(ReplayRun(nominal_, runs_[i], kAllCuts, nullptr), runs_[i], kAllCuts, &within[i]);
      return;
    }
    PreparedRun other = Prepare(set.runs[i], nominal_, options.seed * 1000004 + 4 * i + k);
    if (frame_) Turn(*frame_, other);
    other.cell_N = runs_[i].cell_N;
    other.signals.torque_target_Nm = runs_[i].signals.torque_target_Nm;
    // What stands in for a missing cell stands in here, too.
    other.cell_holes = runs_[i].cell_holes;
    for (const CellHole& hole : other.cell_holes) {
      other.signals.tension_N.col(hole.tendon).segment(hole.from, hole.to - hole.from) =
          runs_[i].signals.tension_N.col(hole.tendon).segment(hole.from, hole.to - hole.from);
    }
    readings[k][i] =
        ResidualsOf(ReplayRun(nominal_, other, kC2 | kC3 | kBody, nullptr), other, kC2 | kC3 | kBody);
  });

  variance_.assign(runs, std::vector<Eigen::VectorXd>(channels));
  white_.assign(runs, std::vector<double>(channels, 0.0));
  for (int i = 0; i < runs; ++i) {
    for (int c = 0; c < channels; ++c) {
      auto& r = nominal_residuals_[i][c];
      auto& variance = variance_[i][c];
      const int windows = static_cast<int>(r.size());
      variance.resize(windows);
      if (windows == 0) continue;
      const int width = WindowSamples(runs_[i], channels_[c]);
      double samples_in = width;
      if (channels_[c].cut == sim::Cut::kShape) {
        // The tracker is slower than the grid.
        const double duration = runs_[i].samples() * runs_[i].signals.step_s;
        samples_in = std::clamp(runs_[i].tracker_s.size() / duration * width * runs_[i].signals.step_s, 1.0,
                                static_cast<double>(width));
      }
      const double white = channels_[c].white * channels_[c].white / samples_in;
      white_[i][c] = white;
      // Spread over the readings, smoothed over neighbouring windows: four draws alone say little.
      Eigen::VectorXd spread = Eigen::VectorXd::Zero(windows);
      if (readings[0][i][c].size() == windows) {
        Eigen::VectorXd scatter(windows);
        for (int w = 0; w < windows; ++w) {
          // The readings scatter about the truth as the best reading does: twice their distance from it, half
          // of it each.
          double square = 0;
          for (int k = 0; k < kReadings; ++k) square += std::pow(readings[k][i][c][w] - r[w], 2);
          scatter[w] = std::isfinite(square) ? square / kReadings : 0;
        }
        const int reach =
            std::max(1, static_cast<int>(0.5 * kResolutionWindow_s / (width * runs_[i].signals.step_s)));
        for (int w = 0; w < windows; ++w) {
          const int a = std::max(0, w - reach), b = std::min(windows, w + reach + 1);
          spread[w] = std::max(scatter.segment(a, b - a).mean(), 0.5 * scatter[w]);
        }
      }
      // A residual that changes within a window by more than white noise does is a transient (a motor
      // breaking loose, a tendon catching), and what the window's mean is depends on microseconds.
      if (channels_[c].quantity == Quantity::kTension) {
        // What scatters in half of the windows is noise: of the torque as well, where it is the input.
        std::vector<double> scatters;
        for (const double s : within[i][c]) {
          if (std::isfinite(s)) scatters.push_back(s);
        }
        const double sample = std::max(channels_[c].white * channels_[c].white, Median(scatters));
        for (int w = 0; w < windows; ++w) {
          double most = 0;
          for (int k = std::max(0, w - 1); k <= std::min(windows - 1, w + 1); ++k) {
            if (std::isfinite(within[i][c][k])) most = std::max(most, within[i][c][k]);
          }
          spread[w] += std::max(0.0, most - kTransient * sample);
        }
      }
      // What a target did between the samples of a slow log is open by as much as it changed over them.
      if (channels_[c].quantity == Quantity::kTorque && runs_[i].signals.step_s >= kSlowLog_s) {
        const auto target = runs_[i].signals.torque_target_Nm.col(channels_[c].index);
        for (int w = 1; w + 1 < windows; ++w) {
          const double most =
              std::max(std::abs(target[w] - target[w - 1]), std::abs(target[w + 1] - target[w]));
          spread[w] += most * most;
        }
      }
      for (int w = 0; w < windows; ++w) {
        variance[w] = std::isfinite(r[w]) ? white + spread[w] : std::numeric_limits<double>::infinity();
        if (!std::isfinite(r[w])) r[w] = 0;
      }
    }
  }

  TakeDifferences();
  runs = static_cast<int>(runs_.size());

  // Identical repetitions: half the mean-square difference of their residuals.
  std::map<std::string, int> by_name;
  for (int i = 0; i < runs; ++i) by_name[runs_[i].name] = i;
  int most_returns = 0;
  for (int c = 0; c < channels; ++c) {
    double ratio_sum = 0;
    int count = 0;
    for (int i = 0; i < runs; ++i) {
      const auto original = by_name.find(runs_[i].repeat_of);
      if (runs_[i].repeat_of.empty() || original == by_name.end() || original->second == i) continue;
      repeated_ = true;
      const auto& a = nominal_residuals_[i][c];
      const auto& b = nominal_residuals_[original->second][c];
      const auto& va = variance_[i][c];
      const auto& vb = variance_[original->second][c];
      for (int w = 0; w < std::min(a.size(), b.size()); ++w) {
        if (!std::isfinite(va[w]) || !std::isfinite(vb[w])) continue;
        ratio_sum += std::pow(a[w] - b[w], 2) / (va[w] + vb[w]);
        ++count;
      }
    }
    double scale = count > 20 ? std::max(1.0, ratio_sum / count) : 1;
    if (!repeated_) {
      int returns = 0;
      const double ratio = Unrepeated(c, returns);
      if (returns >= kLeastReturns) {
        scale = std::max(1.0, ratio);
        most_returns = std::max(most_returns, returns);
      }
    }
    std::vector<double> variances;
    for (int i = 0; i < runs; ++i) {
      for (auto& v : variance_[i][c]) {
        v *= scale;
        if (std::isfinite(v)) variances.push_back(v);
      }
    }
    Channel& channel = channels_[c];
    channel.floor = std::sqrt(std::max(Median(variances), channel.white * channel.white));
    const double spread = Spread(channel);
    channel.delta = std::hypot(kFloorShare * channel.floor, kSignalShare * spread);
    if (channel.quantity == Quantity::kTension && options.delta_N > 0) channel.delta = options.delta_N;
    if (channel.quantity == Quantity::kTipPosition && options.delta_m > 0) channel.delta = options.delta_m;
  }
  if (most_returns > 0) {
    degradations_.push_back(
        fmt::format("no repeated runs: the noise floor is how much the residual differs between {} pairs of "
                    "rows with the same "
                    "motor positions within {:.0f} % of their range; what depends on the way there "
                    "(friction) is in the floor",
                    most_returns, 100 * kReturnShare));
  } else if (!repeated_) {
    degradations_.push_back(
        "no repeated runs: the noise floor comes from high-frequency differences and the sensors' "
        "resolution; what the "
        "robot itself does not repeat is counted as gap");
  }
}

unsigned Evaluator::CutsOf(const sim::Effect& effect) const {
  const bool pulleys =
      std::any_of(nominal_.actuation->tendons.begin(), nominal_.actuation->tendons.end(),
                  [](const TendonDriveParameters& p) { return !p.transmission.pulleys.empty(); });
  const std::string_view named = effect.name;
  if (!pulleys && (named.starts_with("capstan_") || named == "wrap_angle")) return 0;
  // Motors go where they were seen to go, whatever turns them.
  if (driven_by_ == sim::Replay::DrivenBy::kMotor && effect.stage == sim::Stage::kDrive)
    return has(kC1) ? unsigned{kC1} : 0U;
  if (driven_by_ != sim::Replay::DrivenBy::kCell) {
    return effect.cut == sim::Cut::kCurrentLoop ? unsigned{kC1} : unsigned{kAllCuts};
  }
  const std::string_view name = effect.name;
  switch (effect.stage) {
    case sim::Stage::kDrive:
      if (effect.cut == sim::Cut::kCurrentLoop || effect.cut == sim::Cut::kClock) return kC1;
      return stood_in_ ? kC2 | kC3 | kBody : kC2;
    case sim::Stage::kTransmission:
      if (runs_[0].signals.load_cell == LoadCellPlace::kMotorSide &&
          (name == "tendon_stiffness" || name == "tendon_creep" || name == "slack"))
        return kC3;
      return kC2 | kC3 | kBody;
    case sim::Stage::kBody:
      return runs_[0].signals.load_cell == LoadCellPlace::kMotorSide ? kC3 | kBody : kC2 | kC3 | kBody;
    case sim::Stage::kSensor:
      return kC2 | kC3 | kBody;
  }
  return kAllCuts;
}

Evaluator::Curve Evaluator::CurveOf(const RobotParameters& robot, int run_index, int channel_index) const {
  const PreparedRun& run = runs_[run_index];
  const Channel& channel = channels_[channel_index];
  const unsigned cut = channel.cut == sim::Cut::kCurrentLoop  ? kC1
                       : channel.cut == sim::Cut::kDrivetrain ? kC2
                       : channel.cut == sim::Cut::kTendon     ? kC3
                                                              : kBody;
  const Replayed replayed = ReplayRun(robot, run, cut | kBody, &nominal_motion_[run_index]);
  const Eigen::VectorXd residual = ResidualsOf(replayed, run, cut)[channel_index];
  const int width = WindowSamples(run, channel);
  Curve curve;
  const int windows = static_cast<int>(residual.size());
  curve.time_s.resize(windows);
  curve.simulated.resize(windows);
  for (int w = 0; w < windows; ++w) curve.time_s[w] = (w + 0.5) * width * run.signals.step_s;
  if (channel.cut == sim::Cut::kShape) {
    const double stride_s = run.signals.step_s;
    const int rows = static_cast<int>(replayed.motion.tip_m.rows());
    for (int w = 0; w < windows; ++w) {
      const int k = std::clamp(static_cast<int>(std::lround(curve.time_s[w] / stride_s)), 0, rows - 1);
      curve.simulated[w] = channel.quantity == Quantity::kTipPosition
                               ? replayed.motion.tip_m(k, channel.index)
                               : replayed.motion.tip_rotation(k, channel.index);
    }
  } else {
    const Eigen::MatrixXd& all = cut == kC1   ? replayed.torque_Nm
                                 : cut == kC2 ? replayed.from_torque_N
                                              : replayed.from_stretch_N;
    curve.simulated = Average(all.col(channel.index), width);
  }
  curve.measured = curve.simulated + residual;
  // The model as the runs from before correct it.
  if (!before_.empty()) curve.simulated += before_[run_index][channel_index];
  return curve;
}

}  // namespace tendril::gap
