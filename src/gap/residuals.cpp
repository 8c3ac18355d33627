// Evaluator, the residuals: replays a run with a robot, cut by cut, and compares, measured less simulated, in
// windows.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "evaluator.h"
#include "tendril/sim/effects.h"
#include "tracked_shape.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

constexpr double kWindow_s = 0.02;  // averaging window of residuals: longer than the sensors' white noise

/// Window means of finite values; NaN without any.
Eigen::VectorXd Average(const Eigen::VectorXd& values, int width) {
  Eigen::VectorXd mean(static_cast<int>(values.size()) / width);
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

/// Column of TipResidual::tip.
Eigen::Index ColumnOfTip(const Channel& channel) {
  const int first = channel.quantity == Quantity::kTipPosition    ? 0
                    : channel.quantity == Quantity::kTipDirection ? 3
                                                                  : 6;
  return first + channel.index;
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

double Evaluator::TrackerLate(const sim::BodyMotion& motion, const PreparedRun& run) const {
  return clocks_free_ ? LateByTip(motion, run) : 0;
}

Evaluator::Replayed Evaluator::ReplayRun(const RobotParameters& robot, const PreparedRun& run, unsigned cuts,
                                         const sim::BodyMotion* known_motion,
                                         sim::Replay::Steps steps) const {
  const sim::Replay replay(robot);
  Replayed out;
  const bool simulate = (cuts & kBody) != 0 || known_motion == nullptr;
  if (simulate) {
    out.motion = replay.Body(run.signals, driven_by_, steps);
    // Tracker effects change the shape that is read from it.
    if ((cuts & (kC2 | kC3)) || HasTrackerEffect(robot)) {
      out.motion.shortening_m = MeasuredShortening(run, robot, out.motion, TrackerLate(out.motion, run));
    }
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

Residuals Evaluator::At(const RobotParameters& robot, unsigned cuts, const std::vector<int>& only,
                        sim::Replay::Steps steps) const {
  Residuals residuals(runs_.size());
  const auto one = [&](int i) {
    const Replayed replayed = ReplayRun(robot, runs_[i], cuts, &nominal_motion_[i], steps);
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
