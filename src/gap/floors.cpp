// The part of the residuals that is not a model error: noise, resolution, imperfect repeatability, and the
// model error before a change.
#include <fmt/core.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

#include "evaluator.h"
#include "median.h"
#include "parallel.h"
#include "repeatability.h"
#include "rotation.h"
#include "same_commands.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

// Minimum materiality as a share of the floor and of the signal: two simulations of one model agree no
// better.
constexpr double kFloorShare = 0.2, kSignalShare = 1e-3;
constexpr double kTransient = 4;  // times the white noise's variance, within one window
constexpr double kResolutionWindow_s = 0.25;
// Motors within this share of their range count as back at the same position; fewer returns than this do not
// show how a robot repeats.
constexpr double kReturnShare = 0.01;
constexpr int kLeastReturns = 20;
constexpr int kLeastWindows = 20;  // of two repetitions, for an estimate of a channel's repeatability
// Repetitions that differ by more (in units of sensor noise) may be of different robots.
constexpr double kOtherRobot = 5;

/// rms of the white noise of a smooth signal, from third differences (robust against motion).
double WhiteNoise(const Eigen::Ref<const Eigen::VectorXd>& signal) {
  std::vector<double> differences;
  for (Eigen::Index i = 3; i < signal.size(); ++i) {
    const double d = signal[i] - 3 * signal[i - 1] + 3 * signal[i - 2] - signal[i - 3];
    if (std::isfinite(d)) differences.push_back(std::abs(d));
  }
  if (differences.size() < 50) return 0;
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::nth_element(differences.begin(), middle, differences.end());
  // The median ignores motion, but for a coarsely rounded signal it is one of a few values; the mean square
  // of differences of that size is more accurate.
  const double most = 4 * *middle / 0.6745;
  double square = 0, count = 0;
  for (const double d : differences) {
    if (d <= most) square += d * d, count += 1;
  }
  return std::sqrt(square / count / 20);
}

/// Own readings of a cell that is slower than the log: an interpolated line has no noise.
Eigen::VectorXd OwnReadings(const PreparedRun& run, int tendon) {
  const std::vector<int>& read = run.cell_read[static_cast<std::size_t>(tendon)];
  return read.empty() ? run.cell_N.col(tendon).eval() : run.cell_N.col(tendon)(read).eval();
}

/// Samples of a channel in one of its windows; trackers and some cells are slower than the grid.
double SamplesIn(const PreparedRun& run, const Channel& channel) {
  const double width = WindowSamples(run, channel);
  if (channel.quantity == Channel::Quantity::kTension && run.cell_N.cols() > channel.index) {
    const auto read = static_cast<double>(run.cell_read[static_cast<std::size_t>(channel.index)].size());
    return read > 0 ? std::clamp(read / run.samples() * width, 1.0, width) : width;
  }
  if (channel.cut != sim::Cut::kShape) return width;
  const double duration = run.samples() * run.signals.step_s;
  return std::clamp(run.tracker_s.size() / duration * width * run.signals.step_s, 1.0, width);
}

/// Spread of alternative readings, from their mean square distance to the best one, smoothed over
/// neighbouring windows because there are few draws. Draws and best reading scatter equally about the truth,
/// so half of that distance belongs to each.
Eigen::VectorXd ReadingSpread(const Eigen::VectorXd& square, double window_s) {
  const auto windows = static_cast<int>(square.size());
  const Eigen::VectorXd scatter = square.array().isFinite().select(square, 0.0);
  const int reach = std::max(1, static_cast<int>(0.5 * kResolutionWindow_s / window_s));
  Eigen::VectorXd spread(windows);
  for (int w = 0; w < windows; ++w) {
    const int a = std::max(0, w - reach), b = std::min(windows, w + reach + 1);
    spread[w] = std::max(scatter.segment(a, b - a).mean(), 0.5 * scatter[w]);
  }
  return spread;
}

/// A residual that changes more within a window than white noise is a transient (a motor breaking loose, a
/// tendon catching) whose mean depends on microseconds. A channel with transients in half of its windows is
/// noisy instead, and so is the torque where it is the input.
Eigen::VectorXd Transients(const Eigen::VectorXd& within, double white) {
  const auto windows = static_cast<int>(within.size());
  std::vector<double> scatters;
  for (const double s : within) {
    if (std::isfinite(s)) scatters.push_back(s);
  }
  const double sample = std::max(white * white, Median(std::move(scatters)));
  Eigen::VectorXd excess(windows);
  for (int w = 0; w < windows; ++w) {
    double most = 0;
    for (int k = std::max(0, w - 1); k <= std::min(windows - 1, w + 1); ++k) {
      if (std::isfinite(within[k])) most = std::max(most, within[k]);
    }
    excess[w] = std::max(0.0, most - kTransient * sample);
  }
  return excess;
}

/// Mean square of white noise of rms `noise` about a whole count after rounding to whole counts: the reported
/// torque of a settled drive.
double RoundedSquare(double noise) {
  constexpr double kNone = 1e-6;
  double square = 0;
  for (int k = 1; noise > 0; ++k) {
    const double beyond = (2 * k - 1) * std::erfc((k - 0.5) / (std::numbers::sqrt2 * noise));
    square += beyond;
    if (beyond < kNone) break;
  }
  return square;
}

/// Share of a run's rows in which the torque of a drive that reports whole counts lies between two of them.
/// Targets are whole counts as well, so a settled torque lies on one and rounding suppresses most of its
/// noise; in between, the rounding error is up to half a count. The share does not depend on the unknown
/// delay, unlike the rows themselves.
double ShareOnItsWay(const sim::ReplaySignals& signals, int tendon, double lag_s, double count_Nm) {
  constexpr double kWhole = 0.01;  // of a count
  const auto whole = [&](double torque_Nm) {
    const double counts = torque_Nm / count_Nm;
    return std::abs(counts - std::round(counts)) < kWhole;
  };
  const auto target = signals.torque_target_Nm.col(tendon), actual = signals.torque_actual_Nm.col(tendon);
  const auto rows_a_change = static_cast<Eigen::Index>(std::ceil(2 * lag_s / signals.step_s));
  Eigen::Index changed = -rows_a_change;
  double rounded = 0, on_its_way = 0;
  for (Eigen::Index i = 0; i < target.size(); ++i) {
    if (i > 0 && target[i] != target[i - 1]) changed = i;
    if (!whole(actual[i])) continue;
    rounded += 1;
    if (i - changed < rows_a_change || !whole(target[i])) on_its_way += 1;
  }
  // Interpolated values across lost rows are not whole counts; a signal that rarely is whole was never
  // rounded.
  return rounded > 0.5 * static_cast<double>(target.size()) ? on_its_way / rounded : 0;
}

/// Uncertainty of a target between the samples of a slow log: its change over them.
Eigen::VectorXd BetweenSamples(const Eigen::Ref<const Eigen::VectorXd>& target, int windows) {
  Eigen::VectorXd square = Eigen::VectorXd::Zero(windows);
  for (int w = 1; w + 1 < windows; ++w) {
    const double most = std::max(std::abs(target[w] - target[w - 1]), std::abs(target[w + 1] - target[w]));
    square[w] = most * most;
  }
  return square;
}

/// Uncertainty of an approximately straight signal between samples: its curvature there.
Eigen::VectorXd OffStraight(const Eigen::Ref<const Eigen::VectorXd>& target, int windows) {
  Eigen::VectorXd square = Eigen::VectorXd::Zero(windows);
  for (int w = 1; w + 1 < windows; ++w)
    square[w] = 0.25 * std::pow(target[w - 1] - 2 * target[w] + target[w + 1], 2);
  return square;
}

/// How alike the commands of run `i` and of its run from before are; throws RunError where they cannot be
/// compared.
CommandsCompared RequireComparable(std::size_t i, const PreparedRun& run, const PreparedRun& before) {
  const double step = run.signals.step_s, its = before.signals.step_s;
  if (run.signals.at_rest != before.signals.at_rest || std::abs(step - its) > 0.01 * step) {
    throw RunError(i, fmt::format("{}: a sample every {:.4g} s, and every {:.4g} s before; accepted: runs "
                                  "with the same commands, recorded at the same rate",
                                  run.name, step, its));
  }
  const CommandsCompared commands = CompareCommands(run, before);
  if (!commands.same()) {
    throw RunError(i, fmt::format("{}: not the same commands as before: {}; accepted: at most {:.0f} % of "
                                  "the difference between unrelated motions in one of these signals; send "
                                  "the same commands, or diagnose it without --before",
                                  run.name, commands.Text(true), 100 * CommandsCompared::kSame));
  }
  return commands;
}

}  // namespace

void Evaluator::FindFloors(const DataSet& set, const Options& options) {
  FindWhiteNoise();
  FindVariances(set, options);
  MaskAfterUnrecordedMotion(options.threads);
  SubtractBefore();
  ScaleByRepetition(options);
}

// White noise of one sample, from the measured signals; the sensor's resolution is a lower limit even where
// no noise shows.
void Evaluator::FindWhiteNoise() {
  for (auto& channel : channels_) {
    std::vector<double> noise;
    for (const auto& run : runs_) {
      if (run.signals.at_rest) continue;  // differences between states are motion, not noise
      switch (channel.quantity) {
        case Quantity::kTorque: {
          Eigen::VectorXd torque_Nm = run.signals.torque_actual_Nm.col(channel.index);
          run.TakeOut(run.torque_dropouts, channel.index, torque_Nm);
          if (const double n = WhiteNoise(torque_Nm); n > 0) noise.push_back(n);
          break;
        }
        case Quantity::kTension:
          if (run.cell_N.cols() == 0) break;
          if (const double n = WhiteNoise(OwnReadings(run, channel.index)); n > 0) noise.push_back(n);
          break;
        case Quantity::kTipPosition:
          if (run.tip_m.rows() == 0) break;
          if (const double n = WhiteNoise(run.tip_m.col(channel.index)); n > 0) noise.push_back(n);
          break;
        case Quantity::kTipDirection: {
          if (run.tip_R.empty()) break;
          Eigen::MatrixXd turn(static_cast<int>(run.tip_R.size()), 3);
          for (int k = 0; k < turn.rows(); ++k) {
            // Relative to the first orientation, in the tip's own axes, where no rotation is near pi.
            turn.row(k) = RotationVector(run.tip_R[0].transpose() * run.tip_R[k]);
          }
          if (const double n = WhiteNoise(turn.col(channel.index)); n > 0) noise.push_back(n);
          break;
        }
        case Quantity::kBending:
          if (run.bending_rad.rows() == 0) break;
          if (const double n = WhiteNoise(run.bending_rad.col(channel.index)); n > 0) noise.push_back(n);
          break;
      }
    }
    const auto& p =
        nominal_.actuation
            ->tendons[channel.quantity == Quantity::kTorque || channel.quantity == Quantity::kTension
                          ? channel.index
                          : 0];
    double least = 0;  // a sensor's resolution limits it even without visible noise
    if (channel.quantity == Quantity::kTorque)
      least = 1e-3 * p.drive.rated_torque_Nm *
              std::sqrt(std::max(1.0 / 12, RoundedSquare(p.drive.actual_torque_noise_permille)));
    for (const auto& run : runs_) {
      if (channel.quantity == Quantity::kTension && !run.cell_step_N.empty())
        least = std::max(least, run.cell_step_N[static_cast<std::size_t>(channel.index)] / std::sqrt(12.0));
    }
    const auto& tracker = nominal_.actuation->tracker;
    if (channel.quantity == Quantity::kTipPosition)
      least = std::max(1e-6, noise.empty() && tracker ? tracker->position_noise_m : 0);
    if (channel.quantity == Quantity::kTipDirection || channel.quantity == Quantity::kBending)
      least = std::max(1e-5, noise.empty() && tracker ? tracker->orientation_noise_rad : 0);
    channel.white = std::max(least, Median(noise));
  }
}

// The nominal residuals, and their scatter over alternative readings of the same logs.
void Evaluator::FindVariances(const DataSet& set, const Options& options) {
  const int runs = static_cast<int>(runs_.size());
  std::vector<Residuals> readings(static_cast<std::size_t>(options.readings), Residuals(runs));
  Residuals within(runs);
  const auto read = [&](int i, int k) {
    if (k < 0) {
      nominal_residuals_[i] =
          ResidualsOf(ReplayRun(nominal_, runs_[i], kAllCuts, nullptr), runs_[i], kAllCuts, &within[i]);
      return;
    }
    PreparedRun other = Prepare(set.runs[i], nominal_, options.seed * 1000004 + 4 * i + k);
    if (!tracker_late_s_.empty()) other.MoveTracker(-tracker_late_s_[i]);
    if (frame_) frame_->ToBase(other);
    other.cell_N = runs_[i].cell_N;
    other.signals.torque_target_Nm = runs_[i].signals.torque_target_Nm;
    other.signals.no_cell = runs_[i].signals.no_cell;
    other.driven = runs_[i].driven;
    readings[k][i] =
        ResidualsOf(ReplayRun(nominal_, other, kC2 | kC3 | kBody, nullptr), other, kC2 | kC3 | kBody);
  };
  const int tasks = runs * (options.readings + 1);
  std::vector<std::string> trouble(static_cast<std::size_t>(tasks));
  ParallelFor(tasks, options.threads, [&](int task) {
    try {
      read(task % runs, task / runs - 1);
    } catch (const std::runtime_error& error) {
      trouble[static_cast<std::size_t>(task)] = error.what();
    }
  });
  for (int task = 0; task < tasks; ++task) {
    const std::string& what = trouble[static_cast<std::size_t>(task)];
    if (what.empty()) continue;
    const int i = task % runs;
    throw RunError(
        static_cast<std::size_t>(i),
        fmt::format("{}: {}{}", runs_[i].name,
                    task < runs ? "" : "alternative reading within the sensors' resolution: ", what));
  }
  SumVariances(readings, within);
}

// Variance of each window: white noise, and the scatter of the `readings` and `within` a window.
void Evaluator::SumVariances(const std::vector<Residuals>& readings, const Residuals& within) {
  const int runs = static_cast<int>(runs_.size()), channels = static_cast<int>(channels_.size());
  variance_.assign(runs, std::vector<Eigen::VectorXd>(channels));
  carried_ = variance_;
  white_.assign(runs, std::vector<double>(channels, 0.0));
  for (int i = 0; i < runs; ++i) {
    for (int c = 0; c < channels; ++c) {
      auto& r = nominal_residuals_[i][c];
      auto& variance = variance_[i][c];
      const int windows = static_cast<int>(r.size());
      variance.resize(windows);
      if (windows == 0) continue;
      const Channel& channel = channels_[c];
      const sim::ReplaySignals& signals = runs_[i].signals;
      white_[i][c] = channel.white * channel.white / SamplesIn(runs_[i], channel);
      if (channel.quantity == Quantity::kTorque) {
        const auto& p = nominal_.actuation->tendons[static_cast<std::size_t>(channel.index)];
        const double count_Nm = 1e-3 * p.drive.rated_torque_Nm;
        const double between =
            count_Nm * std::hypot(p.drive.actual_torque_noise_permille, std::sqrt(1.0 / 12));
        white_[i][c] += ShareOnItsWay(signals, channel.index, p.motor.torque_lag_s, count_Nm) *
                        std::max(0.0, between * between - white_[i][c]);
      }
      Eigen::VectorXd spread = Eigen::VectorXd::Zero(windows);
      if (!readings.empty() && readings[0][i][c].size() == windows) {
        Eigen::VectorXd scatter = Eigen::VectorXd::Zero(windows);
        for (const Residuals& reading : readings) scatter += (reading[i][c] - r).cwiseAbs2();
        spread = ReadingSpread(scatter / static_cast<int>(readings.size()), window_s(i, c));
      }
      // Rounding errors are constant while nothing moves.
      if (channel.quantity == Quantity::kTipPosition) spread.array() += std::pow(runs_[i].tip_step_m, 2) / 12;
      if (channel.quantity == Quantity::kTipDirection)
        spread.array() += std::pow(runs_[i].tip_step_rad, 2) / 12;
      if (channel.quantity == Quantity::kBending)
        spread.array() += std::pow(runs_[i].bending_step_rad, 2) / 12;
      carried_[i][c] = spread;
      if (channel.quantity == Quantity::kTension) spread += Transients(within[i][c], channel.white);
      if (channel.quantity == Quantity::kTorque && signals.step_s >= kSlowLog_s)
        spread += BetweenSamples(signals.torque_target_Nm.col(channel.index), windows);
      else if (channel.quantity == Quantity::kTorque && signals.commands_a_sample > 1)
        spread += OffStraight(signals.torque_target_Nm.col(channel.index), windows);
      for (int w = 0; w < windows; ++w) {
        variance[w] =
            std::isfinite(r[w]) ? white_[i][c] + spread[w] : std::numeric_limits<double>::infinity();
        if (!std::isfinite(r[w])) r[w] = 0;
      }
    }
  }
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
    if (channel.quantity == Quantity::kTension && has(kC3)) add(run.cell_N);
    // Without cells the tension is taken from the torque, which is accurate enough for this.
    if (channel.quantity == Quantity::kTension && !has(kC3)) {
      const double travel_m =
          nominal_.actuation->tendons[static_cast<std::size_t>(channel.index)].SpoolTravelPerMotorRad();
      if (travel_m > 0) add(run.signals.torque_actual_Nm / travel_m);
    }
    if (channel.quantity == Quantity::kTipPosition) add(run.tip_m);
    if (channel.quantity == Quantity::kBending) add(run.bending_rad);
    if (channel.quantity == Quantity::kTipDirection && !run.tip_R.empty()) {
      Eigen::MatrixXd turns(static_cast<int>(run.tip_R.size()), 3);
      for (int k = 0; k < turns.rows(); ++k) turns.row(k) = RotationVector(run.tip_R[k]);
      add(turns);
    }
  }
  return signals > 0 ? std::sqrt(std::max(0.0, square / signals - std::pow(signal_sum / signals, 2))) : 0;
}

// The model error before the change, and the same relative error of every channel in the change.
void Evaluator::DistrustChange(const std::vector<char>& is_before) {
  std::map<std::pair<sim::Cut, Quantity>, std::pair<double, double>>
      wrong;  // squares: residual before, measurement
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
  // Whether and where something changed then depends on the noise alone, and no cause is named.
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
}

// The nominal residual of a run less that of the same commands before: earlier model errors cancel, window by
// window, and the noise of both runs remains. The model is assumed to have the same relative error in the
// change as in the earlier motion; this is added to the noise.
void Evaluator::SubtractBefore() {
  std::map<std::string, std::size_t> by_name;
  for (std::size_t i = 0; i < runs_.size(); ++i) by_name[runs_[i].name] = i;
  std::vector<char> is_before(runs_.size(), 0);
  int compared = 0;
  CommandsCompared least_alike;
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
                                    runs_[i].before.empty() ? "no run from before, which other runs have"
                                                            : "its run from before is left out"));
    }
    const std::size_t k = partner->second;
    const CommandsCompared commands = RequireComparable(i, runs_[i], runs_[k]);
    if (!commands.by.empty() && (least_alike.by.empty() || commands.by[0].share > least_alike.by[0].share))
      least_alike = commands;
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
  DistrustChange(is_before);
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
  keep(carried_);
  keep(white_);
  keep(before_);
  degradations_.push_back(
      fmt::format("compared with runs of the same commands from before ({}): the diagnosis concerns the "
                  "change since then; the earlier model error (up to {:.0f} % of the measurement) is "
                  "subtracted, and the same relative error is assumed for the change",
                  least_alike.by.empty() ? "matched by name only: no signal that both recorded moves"
                                         : least_alike.Text(false) + " at most",
                  100 * wrong_before_));
}

bool Evaluator::AlikeIn(const Evaluator& other) const {
  if (other.variance_.size() != variance_.size() || other.channels_.size() != channels_.size()) return false;
  for (std::size_t i = 0; i < variance_.size(); ++i) {
    for (std::size_t c = 0; c < channels_.size(); ++c) {
      if (other.variance_[i][c].size() != variance_[i][c].size()) return false;
    }
  }
  return true;
}

bool Evaluator::Widen(const Evaluator& other) {
  constexpr double kClearlyLarger = 1.5;  // times the variance, by the median
  if (!AlikeIn(other)) return false;
  bool any = false;
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    std::vector<Eigen::VectorXd> wider(runs_.size());
    std::vector<double> was, is;
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      wider[i] = variance_[i][c];
      const auto& theirs = other.variance_[i][c];
      for (int w = 0; w < theirs.size(); ++w) {
        double& v = wider[i][w];
        if (!std::isfinite(v) || !std::isfinite(theirs[w])) continue;
        was.push_back(v);
        v = std::max(v, theirs[w]);
        is.push_back(v);
      }
    }
    if (Median(std::move(is)) <= kClearlyLarger * Median(std::move(was))) continue;
    for (std::size_t i = 0; i < runs_.size(); ++i) variance_[i][c] = std::move(wider[i]);
    any = true;
  }
  return any;
}

double Evaluator::Unrepeated(int channel, int& returns) const {
  // States of all runs in sequence.
  struct State {
    int run, row;
  };
  std::vector<State> states;
  // Without any motor positions, by the tendons' tensions.
  const bool motors =
      std::any_of(runs_.begin(), runs_.end(), [](const PreparedRun& r) { return !r.without_motors(); });
  const auto by = motors ? &sim::ReplaySignals::motor_angle_rad : &sim::ReplaySignals::tension_N;
  double range = 0;
  for (int j = 0; j < nominal_.body.tendons(); ++j) {
    double least = INFINITY, most = -INFINITY;
    for (const PreparedRun& run : runs_) {
      if (!run.signals.at_rest) continue;
      least = std::min(least, (run.signals.*by).col(j).minCoeff());
      most = std::max(most, (run.signals.*by).col(j).maxCoeff());
    }
    range = std::max(range, most - least);
  }
  for (int i = 0; i < static_cast<int>(runs_.size()); ++i) {
    if (!runs_[i].signals.at_rest) continue;
    for (int w = 0; w < nominal_residuals_[i][channel].size(); ++w) {
      const auto unseen = [&](const Dropout& dropout) { return dropout.from <= w && w < dropout.to; };
      const auto& dropouts = motors ? runs_[i].motor_dropouts : runs_[i].cell_dropouts;
      if (std::isfinite(variance_[i][channel][w]) && std::none_of(dropouts.begin(), dropouts.end(), unseen))
        states.push_back({i, w});
    }
  }
  double sum = 0;
  returns = 0;
  for (std::size_t b = 1; b < states.size(); ++b) {
    const auto at = (runs_[states[b].run].signals.*by).row(states[b].row);
    for (std::size_t a = 0; a < b; ++a) {
      // A motor that never moved has not returned.
      if (states[a].run == states[b].run && states[b].row - states[a].row < 3) continue;
      const auto was = (runs_[states[a].run].signals.*by).row(states[a].row);
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

// How much more identical runs differ than noise and resolution explain, and the resulting floor and
// materiality of each channel.
void Evaluator::ScaleByRepetition(const Options& options) {
  const int runs = static_cast<int>(runs_.size()), channels = static_cast<int>(channels_.size());
  // Identical repetitions: half the mean-square difference of their residuals.
  std::map<std::string, int> by_name;
  for (int i = 0; i < runs; ++i) by_name[runs_[i].name] = i;
  int most_returns = 0;
  struct Repeated {
    double ratio = 0, square = 0;  // half a squared difference over its noise, and that difference itself
    int windows = 0;
    bool known() const { return windows > kLeastWindows; }
  };
  std::vector<Repeated> repeats(static_cast<std::size_t>(channels));
  repetitions_by_ = Eigen::VectorXd::Ones(channels);
  for (int c = 0; c < channels; ++c) {
    Repeated& repeated = repeats[static_cast<std::size_t>(c)];
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
        repeated.ratio += std::pow(a[w] - b[w], 2) / (va[w] + vb[w]);
        repeated.square += 0.5 * std::pow(a[w] - b[w], 2);
        ++repeated.windows;
      }
    }
    if (repeated.windows > 0) {
      repeated.ratio /= repeated.windows;
      repeated.square /= repeated.windows;
    }
  }
  // A motor that rested in the repeated runs and moves in others is assumed to repeat no better than the
  // others of its kind.
  const auto others = [&](int c) {
    Repeated sum;
    for (int o = 0; o < channels; ++o) {
      const Repeated& other = repeats[static_cast<std::size_t>(o)];
      if (channels_[o].cut != channels_[c].cut || channels_[o].quantity != channels_[c].quantity) continue;
      if (!other.known()) continue;
      sum.ratio += other.ratio * other.windows;
      sum.square += other.square * other.windows;
      sum.windows += other.windows;
    }
    if (sum.windows > 0) sum.ratio /= sum.windows, sum.square /= sum.windows;
    return sum;
  };
  if (!options.repeats && options.with_cause == nullptr) repeatability_ = FindRepeatability(*this, options);
  const Evaluator* other = options.with_cause;
  if (other != nullptr && !AlikeIn(*other))
    throw std::invalid_argument("with a cause, other places are measured");
  if (options.repeats || other != nullptr) repeats.assign(repeats.size(), {});
  for (int c = 0; c < channels; ++c) {
    const Repeated& own = repeats[static_cast<std::size_t>(c)];
    const Repeated from = own.known() ? own : others(c);
    double scale = from.known() ? std::max(1.0, from.ratio) : 1;
    const double least = own.known() || !from.known() ? 0 : from.square;
    repetitions_by_[c] = std::sqrt(scale);
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
      auto& variance = variance_[i][c];
      for (Eigen::Index w = 0; w < variance.size(); ++w) {
        double& v = variance[w];
        v = std::max(scale * v, least);
        if (!std::isfinite(v)) continue;
        if (other != nullptr && std::isfinite(other->variance_[i][c][w]))
          v = std::max(v, other->variance_[i][c][w]);
        variances.push_back(v);
      }
      carried_[i][c] *= scale;
    }
    Channel& channel = channels_[c];
    channel.floor = std::sqrt(std::max(Median(variances), channel.white * channel.white));
    const double spread = Spread(channel);
    channel.delta = std::hypot(kFloorShare * channel.floor, kSignalShare * spread);
    if (channel.quantity == Quantity::kTension && options.delta_N > 0) channel.delta = options.delta_N;
    if (channel.quantity == Quantity::kTipPosition && options.delta_m > 0) channel.delta = options.delta_m;
  }
  if (other != nullptr) repetitions_by_ = other->repetitions_by_, repeatability_ = other->repeatability_;
  int differs_most = 0;
  const double most = channels > 0 ? repetitions_by_.maxCoeff(&differs_most) : 1;
  repetitions_differ_ = most > kOtherRobot ? most : 0;
  if (repetitions_differ_ > 0) {
    degradations_.push_back(
        fmt::format("repetitions differ by {:.2g} times the sensor noise ({}): this is the noise floor, and "
                    "smaller gaps are not seen; if anything was changed between them, they are not "
                    "repetitions (repeat_of: none in runs.yaml)",
                    repetitions_differ_, channels_[static_cast<std::size_t>(differs_most)].name));
  }
  if (most_returns > 0) {
    degradations_.push_back(fmt::format(
        "no repeated runs: the noise floor is the residual's difference between {} pairs of rows with equal "
        "motor positions (within {:.0f} % of their range); path dependence (friction) counts as noise",
        most_returns, 100 * kReturnShare));
  } else if (!repeated_) {
    degradations_.push_back(
        "no repeated runs: the noise floor comes from high-frequency differences and the sensors' "
        "resolution; imperfect repeatability of the robot counts as gap");
  }
}

}  // namespace tendril::gap
