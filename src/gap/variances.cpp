// Evaluator, the noise in the residuals: white noise and resolution of the sensors, and what they make of the
// signals that drive the model.
#include <fmt/core.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "evaluator.h"
#include "median.h"
#include "rotation.h"
#include "tendril/core/parallel.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

constexpr double kTransient = 4;  // times the white noise's variance, within one window
constexpr double kResolutionWindow_s = 0.25;

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

}  // namespace

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

}  // namespace tendril::gap
