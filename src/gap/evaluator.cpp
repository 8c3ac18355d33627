// Residuals at the cuts.
#include "evaluator.h"

#include <fmt/core.h>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>

#include "clocks.h"
#include "median.h"
#include "parallel.h"
#include "rotation.h"
#include "squares.h"
#include "tendril/gap/cuts.h"
#include "tendril/model/body.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

constexpr double kWindow_s = 0.02;  // averaging window of residuals: longer than the sensors' white noise
constexpr double kBendingWindow_s = 0.15;  // the tracker corrects the simulated bending more slowly than this
// Free tracker clock: maximum distance from the estimated shift, step, and number of Gauss-Newton passes.
constexpr double kMostLate_s = 0.08, kLateStep_s = 0.01;
constexpr int kClockPasses = 2;
// Correlation time of model errors; for states at rest, a number of states.
constexpr double kCorrelation_s = 1.0, kCorrelationStates = 5;

/// (u, v) of the bend that takes z to the frame's z axis; independent of twist.
Eigen::Vector2d BendOf(const Eigen::Matrix3d& R) {
  const Eigen::Vector3d z = R.col(2);
  const double side = std::hypot(z.x(), z.y());
  const double bend = std::atan2(side, z.z());
  return side > 1e-12 ? Eigen::Vector2d(bend / side * z.head<2>()) : Eigen::Vector2d(0, 0);
}

/// Bend of a single arc with its tip at p.
Eigen::Vector2d BendOfTip(const Eigen::Vector3d& p) {
  const double side = std::hypot(p.x(), p.y());
  const double bend = 2 * std::atan2(side, p.z());
  return side > 1e-12 ? Eigen::Vector2d(bend / side * p.head<2>()) : Eigen::Vector2d(0, 0);
}

int Windows(int samples, int width) { return samples / width; }

/// Window means of finite values; NaN without any.
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

std::optional<EffectSetting> Setting(const RobotParameters& robot, std::string_view name) {
  for (const auto& effect : robot.effects) {
    if (effect.name == name) return effect;
  }
  return std::nullopt;
}

/// Measured less simulated tip, with the readings `late_s` later than stamped.
struct TipResidual {
  Eigen::MatrixXd
      tip;  // S x (6 + 2K): position, rotation vector, (us, vs) per section; NaN without a reading
  double square_m2 = 0;  // sum over the positions
  double later_s = 0;    // Gauss-Newton step of late_s towards the least squares
};

TipResidual ResidualOfTip(const sim::BodyMotion& motion, const PreparedRun& run, double late_s) {
  const int samples = run.samples(), rows = static_cast<int>(motion.tip_m.rows());
  const double step_s = run.signals.step_s;
  TipResidual out;
  const Eigen::Index bends = motion.bending_rad.cols();
  out.tip = Eigen::MatrixXd::Constant(samples, 6 + bends, NAN);
  double slope = 0, curvature = 0;
  for (int k = 0; k < run.tracker_s.size(); ++k) {
    const double row = std::clamp((run.tracker_s[k] - late_s) / step_s, 0.0, rows - 1.0);
    const int r0 = std::min(static_cast<int>(row), rows - 1), r1 = std::min(r0 + 1, rows - 1);
    const double share = row - r0;
    const int at = std::clamp(static_cast<int>(std::lround(run.tracker_s[k] / step_s)), 0, samples - 1);
    if (run.bending_rad.rows() > 0) {
      out.tip.row(at).tail(bends) = run.bending_rad.row(k) - (1 - share) * motion.bending_rad.row(r0) -
                                    share * motion.bending_rad.row(r1);
    }
    const Eigen::RowVector3d moved_m = motion.tip_m.row(r1) - motion.tip_m.row(r0);
    const bool placed = run.tip_m.rows() > 0;
    const Eigen::RowVector3d off_m =
        placed ? Eigen::RowVector3d(run.tip_m.row(k) - motion.tip_m.row(r0) - share * moved_m)
               : Eigen::RowVector3d::Constant(NAN);
    out.tip.row(at).head<3>() = off_m;
    if (placed && run.driven[static_cast<std::size_t>(at)]) {
      out.square_m2 += off_m.squaredNorm();
      slope += off_m.dot(moved_m) / step_s;
      curvature += moved_m.squaredNorm() / (step_s * step_s);
    }
    if (run.tip_R.empty()) continue;
    const Eigen::Vector3d turn =
        motion.tip_rotation.row(r0) + share * (motion.tip_rotation.row(r1) - motion.tip_rotation.row(r0));
    out.tip.row(at).segment<3>(3) = RotationVector(run.tip_R[k] * Rotation(turn).transpose());
  }
  if (curvature > 0) out.later_s = -slope / curvature;
  return out;
}

/// Column of TipResidual::tip.
Eigen::Index ColumnOfTip(const Channel& channel) {
  const int first = channel.quantity == Quantity::kTipPosition    ? 0
                    : channel.quantity == Quantity::kTipDirection ? 3
                                                                  : 6;
  return first + channel.index;
}

/// The least of a residual over additional delays [s] of up to a tenth of a second: coarse, then by halving.
double LeastOverDelays(const std::function<double(double)>& left) {
  double best_s = 0, least = left(0);
  const auto try_at = [&](double late_s) {
    if (late_s < 0) return;
    if (const double rms = left(late_s); rms < least) best_s = late_s, least = rms;
  };
  double step_s = 0.001;
  for (double late_s = step_s; late_s < 0.1; late_s *= 1.5) try_at(late_s);
  for (step_s = 0.25 * std::max(step_s, best_s); step_s > 5e-5; step_s /= 2) {
    for (const double late_s : {best_s - step_s, best_s + step_s}) try_at(late_s);
  }
  return least;
}

/// Tensions from torque (S x M), NaN where the motor does not slide and torque does not determine them.
Eigen::MatrixXd WhileSliding(Eigen::MatrixXd tension_N, const PreparedRun& run) {
  for (Eigen::Index i = 0; i < tension_N.rows(); ++i) {
    for (Eigen::Index j = 0; j < tension_N.cols(); ++j) {
      if (run.sliding(i, j) == 0) tension_N(i, j) = std::nan("");
    }
  }
  return tension_N;
}

}  // namespace

int WindowSamples(const PreparedRun& run, const Channel& channel) {
  if (channel.quantity == Quantity::kTorque) return 1;
  return std::max(1, static_cast<int>(std::lround(kWindow_s / run.signals.step_s)));
}

void TrackerFrame::ToBase(PreparedRun& run) const {
  for (Eigen::Index k = 0; k < run.tip_m.rows(); ++k)
    run.tip_m.row(k) = (turn.transpose() * (run.tip_m.row(k).transpose() - offset_m)).transpose();
  for (auto& R : run.tip_R) R = turn.transpose() * R;
}

Evaluator::Evaluator(const DataSet& set, const Options& options) : nominal_(set.robot) {
  if (!nominal_.actuation) {
    throw std::runtime_error(fmt::format(
        "robot '{}' has no actuation; accepted: a robot file with motors, tendons and sensors; use the "
        "file that the robot was controlled with",
        nominal_.name));
  }
  runs_.resize(set.runs.size());
  std::vector<std::string> trouble(runs_.size());
  const auto leave_out_the_first = [&] {
    for (std::size_t i = 0; i < trouble.size(); ++i) {
      if (!trouble[i].empty()) throw RunError(i, trouble[i]);
    }
  };
  ParallelFor(static_cast<int>(set.runs.size()), options.threads, [&](int i) {
    try {
      runs_[i] = Prepare(set.runs[i], nominal_);
    } catch (const std::runtime_error& error) {
      trouble[i] = error.what();
    }
  });
  leave_out_the_first();

  FindCuts(set);
  FindTargetsPerRow();
  SubstituteMissingCells();
  zeros_from_rest_ =
      std::all_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.rest_samples > 0; });
  if (zeros_from_rest_) {
    degradations_.push_back(
        fmt::format("motor positions count from where friction had left the robot when it was armed: their "
                    "zero is estimated from the {}, so encoder_offset and slack cannot be seen",
                    has(kC3) ? "load cells there" : "torques"));
  }
  ReportSensorGaps();
  ListChannels();

  nominal_motion_.resize(runs_.size());
  nominal_residuals_.resize(runs_.size());
  ParallelFor(static_cast<int>(runs_.size()), options.threads, [&](int i) {
    try {
      nominal_motion_[i] = sim::Replay(nominal_).Body(runs_[i].signals, driven_by_, 1);
    } catch (const std::runtime_error& error) {
      trouble[i] = fmt::format("{}: {}", runs_[i].name, error.what());
    }
  });
  leave_out_the_first();
  if (has_tracker()) {
    const auto& tracker = nominal_.actuation->tracker;
    TrackerClocks clocks = CompareClocks(runs_, nominal_motion_, tracker ? tracker->delay_s : 0);
    tracker_late_s_ = std::move(clocks.late_s);
    for (std::size_t i = 0; i < runs_.size(); ++i) runs_[i].MoveTracker(-tracker_late_s_[i]);
    clocks_free_ = !clocks.note.empty();
    if (clocks_free_) degradations_.push_back(std::move(clocks.note));
    if (set.fit_frame) FindFrame();
  }
  ParallelFor(static_cast<int>(runs_.size()), options.threads, [&](int i) {
    nominal_motion_[i].shortening_m = MeasuredShortening(runs_[i], nominal_, nominal_motion_[i]);
  });
  if (std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.signals.at_rest; })) {
    degradations_.push_back(
        fmt::format("rows are more than {} s apart: the body is assumed at rest at each row, and tendons to "
                    "slide steadily in between; motion (C5), damping and delays are not seen",
                    kQuasiStatic_s));
  }
  FindFloors(set, options);
}

// Determines the cuts that all runs together allow, and what drives the replays.
void Evaluator::FindCuts(const DataSet& set) {
  const auto every = [&](auto&& test) { return std::all_of(runs_.begin(), runs_.end(), test); };
  const auto any = [&](auto&& test) { return std::any_of(runs_.begin(), runs_.end(), test); };
  const bool motor = any([](const PreparedRun& r) { return !r.without_motors(); });
  // A run with empty columns is diagnosed with the signals that it has.
  const bool torque = every([](const PreparedRun& r) { return r.signals.torque_actual_Nm.cols() > 0; }) &&
                      any([](const PreparedRun& r) {
                        return r.LeaveSamples(r.torque_dropouts, r.signals.torque_actual_Nm.cols());
                      });
  const bool target = every([](const PreparedRun& r) { return r.signals.torque_target_Nm.cols() > 0; }) &&
                      any([](const PreparedRun& r) {
                        return r.LeaveSamples(r.target_dropouts, r.signals.torque_target_Nm.cols());
                      });
  const auto cell_of = [](const PreparedRun& r) {
    return r.signals.load_cell != LoadCellPlace::kNone && r.signals.tension_N.cols() > 0;
  };
  const bool cell = every(cell_of) && any([](const PreparedRun& r) {
                      return r.LeaveSamples(r.cell_dropouts, r.signals.tension_N.cols());
                    });
  const bool tracker = any([](const PreparedRun& r) { return r.tracked(); });
  available_ = (torque && target ? kC1 : 0u) | (torque && motor ? kC2 : 0u) | (cell && motor ? kC3 : 0u) |
               (tracker ? kBody : 0u);
  driven_by_ = cell ? sim::Replay::DrivenBy::kCell : sim::Replay::DrivenBy::kMotor;
  // The body is simulated with every comparison.
  const std::vector<CutOfSet> cuts = gap::CutsOf(set);
  if (available_ == 0 || !(cell || motor)) {
    throw std::runtime_error(
        "nothing in these runs can drive the model and be compared with it: " + CutsLine(cuts) +
        "; accepted: load cells or motor positions of every tendon, and a second channel to "
        "compare with (torque, tension, or the body's shape)");
  }
  if (std::any_of(cuts.begin(), cuts.end(), [](const CutOfSet& c) { return !c.allowed(); }))
    degradations_.push_back(CutsLine(cuts));
  if (!motor) ReportMissingMotors();
  if (!target || !torque)
    degradations_.push_back("no target or actual torque: the drives' current loop (C1) is not seen");
  if (!cell) {
    degradations_.push_back(
        torque ? fmt::format("no load cell: the tensions on the body are taken from the motors and the "
                             "tendons' stretch{}; drivetrain, tendons and body (C2 to C5) cannot be told "
                             "apart by place, only by cause",
                             every([](const PreparedRun& r) { return r.signals.at_rest; })
                                 ? ""
                                 : ", and compared with torque")
               : "no load cell and no torque: the body is driven by motor positions alone; tensions are not "
                 "known, so drive and friction effects are not seen");
  }
  if (cell && !torque) degradations_.push_back("no actual torque: motors and gears (C2) are not seen");
  if (!tracker) {
    degradations_.push_back(
        "no tracker: shape and motion (C4, C5) are not seen; body effects show only through tendon "
        "displacement (C3) and "
        "cannot be told from tendon effects by place");
  }
}

// Load cells drive the body by themselves; the chain before them is not seen.
void Evaluator::ReportMissingMotors() {
  const bool before_pulleys = std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) {
    return r.signals.load_cell == LoadCellPlace::kMotorSide;
  });
  degradations_.push_back(fmt::format(
      "no motor positions: motors, gears and the tendons' stretch (C2, C3) are not seen{}",
      before_pulleys ? ", and how far a tendon slides over its pulleys follows from the body's shape and the "
                       "tendon's stretch: the direction of friction is known where the shape moves, and "
                       "without bending (all tendons pulled alike) only from the stretch"
                     : ""));
}

// A controller's target acts a cycle after it was sent. In a log of every n-th cycle motors seem to respond
// at once, or early; the actual torque shows how many targets were sent per row, if each number is judged at
// the delay that suits it best: a drive that is late is no reason to believe in fewer targets.
void Evaluator::FindTargetsPerRow() {
  constexpr double kFastest_s = 0.9e-3;  // of controllers
  constexpr double kClearlyLess = 0.8;   // of the residual with one target per row
  constexpr double kAtNoise = 1.3;       // of noise and resolution, whose size is known to a third
  double step_s = std::numeric_limits<double>::infinity();
  std::vector<PreparedRun*> in_doubt;
  for (PreparedRun& run : runs_) {
    // In a slower log a row is not one cycle anyway.
    if (run.signals.at_rest || run.signals.command_delay_s < run.signals.step_s) continue;
    in_doubt.push_back(&run);
    step_s = std::min(step_s, run.signals.step_s);
  }
  if (!has(kC1) || in_doubt.empty() || step_s < 2 * kFastest_s) return;
  const auto take = [&](int commands, double late_s) {
    for (PreparedRun* run : in_doubt) {
      run->signals.commands_a_sample = commands;
      run->signals.command_delay_s = run->signals.step_s / commands + late_s;
    }
  };
  const auto left = [&](int commands) {
    return LeastOverDelays([&](double late_s) {
      take(commands, late_s);
      return TorqueLeft(in_doubt);
    });
  };
  std::vector<double> rms{left(1)};  // [0]: one target per row
  int commands = 1;
  double least = kClearlyLess * rms[0];
  for (int n = 2; step_s / n >= kFastest_s; ++n) {
    rms.push_back(left(n));
    if (rms.back() < least) commands = n, least = rms.back();
  }
  take(commands, 0);
  if (commands > 1) {
    degradations_.push_back(
        fmt::format("according to the actual torque, a row (every {:.3g} ms) holds one of {} targets sent: "
                    "those between are interpolated, and a delay shorter than a row cannot be identified",
                    1e3 * step_s, commands));
  }
  // A log of every cycle leaves no more than the noise. Where more is left, slow targets hide how many they
  // were.
  if (commands == 1 && rms[0] < kAtNoise * TorqueNoise()) return;
  int fewest = commands, most = commands;
  for (int n = 1; n <= static_cast<int>(rms.size()); ++n) {
    if (kClearlyLess * rms[static_cast<std::size_t>(n - 1)] > rms[static_cast<std::size_t>(commands - 1)])
      continue;
    fewest = std::min(fewest, n), most = std::max(most, n);
  }
  if (fewest == most) return;
  // A target acts a cycle after its row, and half of the time that it holds later on average.
  delay_unknown_s_ = 1.5 * step_s * (1.0 / fewest - 1.0 / most);
  degradations_.push_back(
      fmt::format("these logs do not show whether a row (every {:.3g} ms) holds every target or one of {}: a "
                  "delay of the drives is known to {:.2g} ms only; log every cycle",
                  1e3 * step_s, most, 1e3 * delay_unknown_s_));
}

// rms of noise and resolution of the actual torque, of the noisiest drive.
double Evaluator::TorqueNoise() const {
  double most_Nm = 0;
  for (const TendonDriveParameters& tendon : nominal_.actuation->tendons) {
    const DriveParameters& drive = tendon.drive;
    const double permille = std::hypot(drive.actual_torque_noise_permille, 1 / std::sqrt(12.0));
    most_Nm = std::max(most_Nm, 1e-3 * drive.rated_torque_Nm * permille);
  }
  return most_Nm;
}

// rms of the actual torque that the targets do not explain, over all runs.
double Evaluator::TorqueLeft(const std::vector<PreparedRun*>& runs) const {
  const sim::Replay replay(nominal_);
  Squares squares;
  for (const PreparedRun* run : runs) {
    const Eigen::MatrixXd off = replay.ActualTorque(run->signals) - run->signals.torque_actual_Nm;
    for (Eigen::Index j = 0; j < off.cols(); ++j) {
      Eigen::VectorXd of_tendon = off.col(j);
      run->TakeOut(run->torque_dropouts, static_cast<int>(j), of_tendon);
      run->TakeOut(run->target_dropouts, static_cast<int>(j), of_tendon);
      for (Eigen::Index i = 0; i < of_tendon.size(); ++i) {
        if (run->valid[static_cast<std::size_t>(i)] && std::isfinite(of_tendon[i])) squares.Add(of_tendon[i]);
      }
    }
  }
  return squares.rms();
}

// Without a cell, the tension on the body follows from the tendon's stretch between motor and body; without a
// motor position as well, it is unknown.
void Evaluator::SubstituteMissingCells() {
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    PreparedRun& run = runs_[i];
    const bool by_cell = driven_by_ == sim::Replay::DrivenBy::kCell;
    auto& no_cell = run.signals.no_cell;
    if (by_cell && !run.cell_dropouts.empty()) {
      no_cell.setZero(run.samples(), nominal_.body.tendons());
      for (const Dropout& dropout : run.cell_dropouts)
        no_cell.col(dropout.tendon).segment(dropout.from, dropout.size()).setOnes();
    }
    for (const Dropout& dropout : run.motor_dropouts) {
      const bool no_other =
          !by_cell || run.MissingSamples(run.cell_dropouts, dropout.tendon) == run.samples();
      if (no_other && dropout.size() == run.samples()) {
        const bool tension = run.signals.tension_N.cols() > 0 && !by_cell;
        throw RunError(i,
                       fmt::format("{}: {} of tendon {}{}", run.name,
                                   tension ? "no motor position" : "neither tension nor motor position",
                                   dropout.tendon + 1,
                                   tension ? ", and other runs have no load cells to drive the body" : ""));
      }
    }
  }
}

// Reports gaps of single sensors, one sentence per sensor with all its runs.
void Evaluator::ReportSensorGaps() {
  const auto tell = [&](std::vector<Dropout> PreparedRun::*dropouts, const char* what, const char* so) {
    std::map<std::string, std::string> tendons;  // by the rest of the sentence
    for (int j = 0; j < nominal_.body.tendons(); ++j) {
      std::string names;
      double lost_s = 0, all_s = 0;
      for (const PreparedRun& run : runs_) {
        const int samples = run.MissingSamples(run.*dropouts, j);
        if (samples == 0) continue;
        lost_s += samples * run.signals.step_s;
        all_s += run.samples() * run.signals.step_s;
        names += (names.empty() ? "" : ", ") + run.name;
      }
      if (names.empty()) continue;
      std::string& those =
          tendons[lost_s < all_s ? fmt::format(" has no data for {:.3g} of {:.3g} s: {} there ({})", lost_s,
                                               all_s, so, names)
                                 : fmt::format(" has no data, or readings more than {:.0f} ms apart: {} ({})",
                                               1e3 * kBridged_s, so, names)];
      those += fmt::format("{}{}", those.empty() ? "" : ", ", j + 1);
    }
    for (const auto& [text, those] : tendons) {
      const bool one = those.find(',') == those.npos;
      degradations_.push_back(fmt::format("the {} of tendon{} {}{}", what, one ? "" : "s", those, text));
    }
  };
  if (driven_by_ == sim::Replay::DrivenBy::kCell) {
    tell(&PreparedRun::cell_dropouts, "load cell",
         "the tension is taken from the motor and the tendon's stretch");
  }
  if (has(kC1)) tell(&PreparedRun::target_dropouts, "target torque", "its drive (C1) is not seen");
  if (has(kC1) || has(kC2))
    tell(&PreparedRun::torque_dropouts, "actual torque", "its drive and drivetrain (C1, C2) are not seen");
  const bool motors =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return !r.without_motors(); });
  if (motors)
    tell(&PreparedRun::motor_dropouts, "motor position", "its drivetrain and tendon (C2, C3) are not seen");
  std::string names;
  for (const PreparedRun& run : runs_) {
    if (has_tracker() && !run.tracked()) names += (names.empty() ? "" : ", ") + run.name;
  }
  if (!names.empty())
    degradations_.push_back("no tracker: shape and motion (C4, C5) are not seen there (" + names + ")");
}

void Evaluator::ListChannels() {
  const int tendons = nominal_.body.tendons();
  for (int j = 0; j < tendons; ++j) {
    if (has(kC1))
      channels_.push_back(
          {sim::Cut::kCurrentLoop, Quantity::kTorque, j, fmt::format("torque {}", j + 1), "N·m"});
  }
  for (int j = 0; j < tendons; ++j) {
    const char* what = has(kC3) ? "tension {} from torque" : "tension {} from torque, against stretch";
    if (has(kC2))
      channels_.push_back(
          {sim::Cut::kDrivetrain, Quantity::kTension, j, fmt::format(fmt::runtime(what), j + 1), "N"});
  }
  for (int j = 0; j < tendons; ++j) {
    if (has(kC3))
      channels_.push_back(
          {sim::Cut::kTendon, Quantity::kTension, j, fmt::format("tension {} from stretch", j + 1), "N"});
  }
  const bool turned =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return !r.tip_R.empty(); });
  const bool placed =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.tip_m.rows() > 0; });
  const bool bent =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return r.bending_rad.rows() > 0; });
  if (placed && !turned)
    degradations_.push_back("the tracker gives no orientation: shape from the tip's position alone");
  if (turned && !placed)
    degradations_.push_back("the tracker gives no position: shape from the tip's orientation alone");
  if (bent && !placed && !turned) {
    degradations_.push_back(
        "no tip pose: shape from the bending of each section; lengths, and effects that shift the tip "
        "without bending the body, are not seen");
  }
  for (int i = 0; i < 3; ++i) {
    if (placed)
      channels_.push_back(
          {sim::Cut::kShape, Quantity::kTipPosition, i, fmt::format("tip {}", "xyz"[i]), "m"});
  }
  for (int i = 0; i < 3; ++i) {
    if (turned)
      channels_.push_back(
          {sim::Cut::kShape, Quantity::kTipDirection, i, fmt::format("tip rotation {}", "xyz"[i]), "rad"});
  }
  for (int k = 0; bent && k < 2 * static_cast<int>(nominal_.body.sections.size()); ++k) {
    channels_.push_back({sim::Cut::kShape, Quantity::kBending, k,
                         fmt::format("bending {}_{}", k % 2 == 0 ? "us" : "vs", k / 2 + 1), "rad"});
  }
}

bool Evaluator::has_position() const {
  return std::any_of(channels_.begin(), channels_.end(),
                     [](const Channel& c) { return c.quantity == Quantity::kTipPosition; });
}

double Evaluator::Correlated(int run, int channel) const {
  return runs_[run].signals.at_rest ? kCorrelationStates
                                    : std::max(1.0, kCorrelation_s / window_s(run, channel));
}

// The rigid motion that maps the nominal robot's tips onto the measured ones, by least squares with reduced
// weight for large distances (Kabsch, reweighted), since the error of a differing robot is not uniform.
void Evaluator::FindFrame() {
  constexpr int kPasses = 20;
  constexpr double kLeastSpread =
      0.02;  // lateral spread of the tips relative to the main one: below, the rotation is undetermined
  if (!has_position()) {
    throw std::runtime_error(
        "tracker_frame: fit: no tip positions in these runs; accepted: tip positions, or a known frame");
  }
  std::vector<Eigen::Vector3d> simulated, measured;
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    const PreparedRun& run = runs_[i];
    if (!run.tracked() || run.tip_m.rows() == 0) continue;
    const int last = static_cast<int>(nominal_motion_[i].tip_m.rows()) - 1;
    for (int k = 0; k < run.tracker_s.size(); ++k) {
      const int at =
          std::clamp(static_cast<int>(std::lround(run.tracker_s[k] / run.signals.step_s)), 0, last);
      if (run.driven[static_cast<std::size_t>(at)] == 0) continue;
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
          "tracker_frame: fit: the tips of these runs lie on a line, so the tracker's frame cannot be "
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
  for (PreparedRun& run : runs_) frame.ToBase(run);
  const Eigen::Vector3d turn = RotationVector(frame.turn);
  degradations_.push_back(fmt::format(
      "the tracker's frame is unknown: fitted to the nominal robot (rotation vector {:.4f}, {:.4f}, {:.4f} "
      "rad, offset {:.2f}, {:.2f}, {:.2f} mm), and refitted within {:.2g} rad and {:.3g} mm with every "
      "cause; effects that look like a wrong frame (a tilt without gravity, an offset) cannot be identified",
      turn.x(), turn.y(), turn.z(), 1e3 * frame.offset_m.x(), 1e3 * frame.offset_m.y(),
      1e3 * frame.offset_m.z(), 3 * TrackerFrame::kTurn_rad, 3e3 * TrackerFrame::Shift_m(nominal_)));
}

double Evaluator::window_s(int run, int channel) const {
  return WindowSamples(runs_[run], channels_[channel]) * runs_[run].signals.step_s;
}

// Shift of the stamps of a tracker with a free clock: the least squares between the tips.
double Evaluator::TrackerLate(const sim::BodyMotion& motion, const PreparedRun& run) const {
  if (!clocks_free_ || !run.tracked() || run.tip_m.rows() == 0 || run.signals.at_rest) return 0;
  double late_s = 0, least_m2 = ResidualOfTip(motion, run, 0).square_m2;
  for (double tried_s = -kMostLate_s; tried_s <= kMostLate_s; tried_s += kLateStep_s) {
    const double square_m2 = ResidualOfTip(motion, run, tried_s).square_m2;
    if (square_m2 < least_m2) least_m2 = square_m2, late_s = tried_s;
  }
  for (int pass = 0; pass < kClockPasses; ++pass)
    late_s += std::clamp(ResidualOfTip(motion, run, late_s).later_s, -kLateStep_s, kLateStep_s);
  return late_s;
}

// Shortening of the tendons in the body. The tracker's bend replaces the simulated one at low frequency; the
// simulation keeps what the tracker's noise hides.
Eigen::MatrixXd Evaluator::MeasuredShortening(const PreparedRun& run, const RobotParameters& robot,
                                              const sim::BodyMotion& motion) const {
  const bool turned = !run.tip_R.empty(), bent = run.bending_rad.rows() > 0;
  const int seen = static_cast<int>(run.tracker_s.size());
  if (!run.tracked() || (!turned && !bent && nominal_.body.sections.size() > 1)) return motion.shortening_m;
  const RobotParameters folded = sim::FoldEffects(robot);
  Eigen::Matrix3d tracker_R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d tracker_p(0, 0, 0);
  if (const auto s = Setting(robot, "tracker_rotation")) {
    const auto v = sim::ValuesOf(*s, robot);
    tracker_R = Rotation({v[0], v[1], v[2]});
  }
  if (const auto s = Setting(robot, "tracker_offset")) {
    const auto v = sim::ValuesOf(*s, robot);
    tracker_p = {v[0], v[1], v[2]};
  }
  const double delay_s =
      folded.actuation->tracker && !run.signals.at_rest ? folded.actuation->tracker->delay_s : 0;

  const double late_s = TrackerLate(motion, run);

  const int samples = run.samples();
  const double step_s = run.signals.step_s;
  // Both as reported: the simulated pose includes the tracker's delay as well.
  const Eigen::Index parts = bent ? run.bending_rad.cols() / 2 : 1;  // that bend independently
  Eigen::MatrixXd difference(seen, 2 * parts);
  for (int k = 0; k < seen; ++k) {
    const int at =
        std::clamp(static_cast<int>(std::lround((run.tracker_s[k] - late_s) / step_s)), 0, samples - 1);
    const Eigen::Vector3d tip = motion.tip_m.row(at).transpose();
    if (bent) {
      difference.row(k) = run.bending_rad.row(k) - motion.bending_rad.row(at);
    } else if (turned) {
      const Eigen::Matrix3d simulated = Rotation(motion.tip_rotation.row(at).transpose());
      difference.row(k) =
          BendOf(tracker_R.transpose() * run.tip_R[k]) - BendOf(tracker_R.transpose() * simulated);
    } else {
      const Eigen::Vector3d measured_tip = run.tip_m.row(k).transpose();
      difference.row(k) = BendOfTip(tracker_R.transpose() * (measured_tip - tracker_p)) -
                          BendOfTip(tracker_R.transpose() * (tip - tracker_p));
    }
  }
  // Mean over a window, then linear onto the grid.
  Eigen::MatrixXd smooth(seen, 2 * parts);
  int low = 0, high = 0;
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(2 * parts);
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
    const double seen_at = i * step_s + delay_s + late_s;
    while (at + 2 < seen && run.tracker_s[at + 1] < seen_at) ++at;
    const double span = run.tracker_s[at + 1] - run.tracker_s[at];
    const double share = span > 0 ? std::clamp((seen_at - run.tracker_s[at]) / span, 0.0, 1.0) : 0;
    const Eigen::RowVectorXd delta = smooth.row(at) + share * (smooth.row(at + 1) - smooth.row(at));
    q = motion.q.row(i).transpose();
    for (int part = 0; part < parts; ++part) {
      const int first = bent ? body.first_unit(part) : 0, end = bent ? body.end_unit(part) : units;
      for (int u = first; u < end; ++u)
        q.segment<2>(2 * u) += delta.segment<2>(2 * part).transpose() / (end - first);
    }
    body.TendonShortening(q, d);
    shortening.row(i) = d.transpose();
  }
  return shortening;
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
    out.motion = replay.Body(run.signals, driven_by_, 1);
    if ((cuts & (kC2 | kC3)) || tracker) out.motion.shortening_m = MeasuredShortening(run, robot, out.motion);
  }
  const Eigen::MatrixXd& shortening = simulate ? out.motion.shortening_m : known_motion->shortening_m;
  if ((cuts & kC1) && has(kC1)) out.torque_Nm = replay.ActualTorque(run.signals);
  if ((cuts & kC2) && has(kC2)) out.from_torque_N = replay.CellFromTorque(run.signals, shortening);
  // Without cells torque is compared with stretch.
  if (((cuts & kC3) && has(kC3)) || ((cuts & kC2) && has(kC2) && !has(kC3)))
    out.from_stretch_N = FromStretch(replay, robot, run, shortening,
                                     has(kC3) ? run.cell_N : WhileSliding(out.from_torque_N, run));
  return out;
}

// At rest the cells give the zero to within a count of the encoder, and without cells the pretension gives it
// to within itself; in that range it follows from the least squares over the whole run.
Eigen::MatrixXd Evaluator::FromStretch(const sim::Replay& replay, const RobotParameters& robot,
                                       const PreparedRun& run, const Eigen::MatrixXd& shortening,
                                       const Eigen::MatrixXd& reading_N) const {
  if (run.rest_samples == 0) return replay.CellFromStretch(run.signals, shortening);
  Eigen::VectorXd zero_rad = replay.ZeroAtRest(run.signals, shortening, run.rest_samples, run.rest_N);
  const Eigen::MatrixXd stretch_N = replay.CellFromStretch(run.signals, shortening, zero_rad);
  const RobotParameters folded = sim::FoldEffects(robot);
  for (Eigen::Index j = 0; j < std::min(stretch_N.cols(), reading_N.cols()); ++j) {
    Eigen::VectorXd left_N = reading_N.col(j) - stretch_N.col(j);
    run.TakeOut(run.motor_dropouts, static_cast<int>(j), left_N);
    double off_N = 0, count = 0;
    for (Eigen::Index i = 0; i < left_N.size(); ++i) {
      // A slack tendon has no defined zero.
      if (!run.driven[static_cast<std::size_t>(i)] || !(stretch_N(i, j) > 0) || std::isnan(left_N[i]))
        continue;
      off_N += left_N[i];
      count += 1;
    }
    if (count == 0) continue;
    const auto& tendon = folded.actuation->tendons[static_cast<std::size_t>(j)];
    const double off_rad = off_N / count / (tendon.tendon.stiffness_Npm * tendon.SpoolTravelPerMotorRad());
    zero_rad[j] -= std::clamp(off_rad, -run.zero_open_rad[j], run.zero_open_rad[j]);
  }
  return replay.CellFromStretch(run.signals, shortening, zero_rad);
}

std::vector<Eigen::VectorXd> Evaluator::ResidualsOf(const Replayed& replayed, const PreparedRun& run,
                                                    unsigned cuts,
                                                    std::vector<Eigen::VectorXd>* scatter) const {
  std::vector<Eigen::VectorXd> residuals(channels_.size());
  if (scatter) scatter->assign(channels_.size(), {});
  const int samples = run.samples();
  Eigen::MatrixXd tip;
  if ((cuts & kBody) && has(kBody) && run.tracked()) {
    tip = ResidualOfTip(replayed.motion, run, TrackerLate(replayed.motion, run)).tip;
  }
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    const Channel& channel = channels_[c];
    Eigen::VectorXd all;
    const auto j = channel.index;
    if (channel.cut == sim::Cut::kCurrentLoop && replayed.torque_Nm.cols() > 0) {
      all = run.signals.torque_actual_Nm.col(j) - replayed.torque_Nm.col(j);
      run.TakeOut(run.target_dropouts, j, all);
      run.TakeOut(run.torque_dropouts, j, all);
    } else if (channel.cut == sim::Cut::kDrivetrain && replayed.from_torque_N.cols() > 0) {
      all = (has(kC3) ? run.cell_N.col(j) : replayed.from_stretch_N.col(j)) - replayed.from_torque_N.col(j);
      for (int i = 0; i < samples; ++i) {
        if (!run.sliding(i, j)) all[i] = std::nan("");
      }
    } else if (channel.cut == sim::Cut::kTendon && replayed.from_stretch_N.cols() > 0) {
      all = run.cell_N.col(j) - replayed.from_stretch_N.col(j);
      run.TakeOut(run.motor_dropouts, j, all);
    } else if (channel.cut == sim::Cut::kShape && tip.rows() > 0) {
      all = tip.col(ColumnOfTip(channel));
    } else {
      continue;
    }
    // The tendons' stretch, and pulleys before a cell, depend on the body's shape, which a tracker samples
    // too slowly.
    const bool beyond = !has(kC3) || run.signals.load_cell == LoadCellPlace::kRobotSide;
    const bool body = channel.cut == sim::Cut::kShape || channel.cut == sim::Cut::kTendon ||
                      (channel.cut == sim::Cut::kDrivetrain && beyond);
    const std::vector<char>& valid = body ? run.driven : run.valid;
    for (int i = 0; i < samples; ++i) {
      if (!valid[static_cast<std::size_t>(i)]) all[i] = NAN;
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
      if (r.size() == 0) continue;
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

unsigned Evaluator::CutsOf(const sim::Effect& effect) const {
  const bool pulleys =
      std::any_of(nominal_.actuation->tendons.begin(), nominal_.actuation->tendons.end(),
                  [](const TendonDriveParameters& p) { return !p.transmission.pulleys.empty(); });
  if (!pulleys && effect.element == sim::Element::kPulleys) return 0;
  const unsigned cuts = CutsBehind(effect.stage, effect.element);
  if (effect.stage != sim::Stage::kDrive) return cuts;
  const bool loop = effect.cut == sim::Cut::kCurrentLoop || effect.cut == sim::Cut::kClock;
  return cuts & (loop ? kC1 : kC2);
}

unsigned Evaluator::CutsBehind(sim::Stage stage, sim::Element element) const {
  // Motors are driven along their measured positions, whatever turns them.
  if (stage == sim::Stage::kDrive) return available_ & (kC1 | kC2);
  // Without a cell a tendon's effect shows in the body.
  const bool no_cell = std::any_of(runs_.begin(), runs_.end(),
                                   [](const PreparedRun& r) { return r.signals.no_cell.size() > 0; });
  if (no_cell || driven_by_ == sim::Replay::DrivenBy::kMotor) return kAllCuts;
  const bool motor_side = std::all_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) {
    return r.signals.load_cell == LoadCellPlace::kMotorSide;
  });
  switch (stage) {
    case sim::Stage::kDrive:
      break;
    case sim::Stage::kTransmission:
      if (motor_side && element == sim::Element::kTendon) return available_ & kC3;
      return kC2 | kC3 | kBody;
    case sim::Stage::kBody:
      return motor_side ? kC3 | kBody : kC2 | kC3 | kBody;
    case sim::Stage::kSensor:
      return kC2 | kC3 | kBody;
  }
  return kAllCuts;
}

Evaluator::Curve Evaluator::NominalCurve(int run_index, int channel_index) const {
  const PreparedRun& run = runs_[run_index];
  const Channel& channel = channels_[channel_index];
  const unsigned cut = channel.cut == sim::Cut::kCurrentLoop  ? kC1
                       : channel.cut == sim::Cut::kDrivetrain ? kC2
                       : channel.cut == sim::Cut::kTendon     ? kC3
                                                              : kBody;
  const Replayed replayed = ReplayRun(nominal_, run, cut | kBody, &nominal_motion_[run_index]);
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
      const Eigen::MatrixXd& shape = channel.quantity == Quantity::kTipPosition ? replayed.motion.tip_m
                                     : channel.quantity == Quantity::kTipDirection
                                         ? replayed.motion.tip_rotation
                                         : replayed.motion.bending_rad;
      curve.simulated[w] = shape(k, channel.index);
    }
  } else {
    const Eigen::MatrixXd& all = cut == kC1   ? replayed.torque_Nm
                                 : cut == kC2 ? replayed.from_torque_N
                                              : replayed.from_stretch_N;
    curve.simulated = Average(all.col(channel.index), width);
  }
  curve.measured = curve.simulated + residual;
  // The model as corrected by the runs from before.
  if (!before_.empty()) curve.simulated += before_[run_index][channel_index];
  return curve;
}

}  // namespace tendril::gap
