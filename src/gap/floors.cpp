// Evaluator, the noise floor and materiality of each channel: its variances, scaled by how runs repeat.
#include <fmt/core.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>

#include "evaluator.h"
#include "median.h"
#include "repeatability.h"
#include "rotation.h"

namespace tendril::gap {
namespace {

using Quantity = Channel::Quantity;

// Minimum materiality as a share of the floor and of the signal: two simulations of one model agree no
// better.
constexpr double kFloorShare = 0.2, kSignalShare = 1e-3;
// Motors within this share of their range count as back at the same position; fewer returns than this do not
// show how a robot repeats.
constexpr double kReturnShare = 0.01;
constexpr int kLeastReturns = 20;
constexpr int kLeastWindows = 20;  // of two repetitions, for an estimate of a channel's repeatability
// Repetitions that differ by more (in units of sensor noise) may be of different robots.
constexpr double kOtherRobot = 5;

/// How far repetitions differ in a channel.
struct Repeated {
  double ratio = 0, square = 0;  // half a squared difference over its noise, and that difference itself
  int windows = 0;
  bool known() const { return windows > kLeastWindows; }
};

/// Index of the run that each run repeats; -1: none.
std::vector<int> OriginalsOf(const std::vector<PreparedRun>& runs) {
  std::map<std::string, int> by_name;
  for (int i = 0; i < static_cast<int>(runs.size()); ++i) by_name[runs[i].name] = i;
  std::vector<int> originals;
  for (int i = 0; i < static_cast<int>(runs.size()); ++i) {
    const auto original = by_name.find(runs[i].repeat_of);
    const bool none = runs[i].repeat_of.empty() || original == by_name.end() || original->second == i;
    originals.push_back(none ? -1 : original->second);
  }
  return originals;
}

/// Half the mean-square difference between the residuals of identical repetitions.
Repeated CompareRepetitions(const Evaluator& evaluator, const std::vector<int>& originals, int channel) {
  Repeated repeated;
  for (std::size_t i = 0; i < originals.size(); ++i) {
    if (originals[i] < 0) continue;
    const auto original = static_cast<std::size_t>(originals[i]);
    const auto& a = evaluator.AtNominal()[i][channel];
    const auto& b = evaluator.AtNominal()[original][channel];
    const auto& va = evaluator.Variance()[i][channel];
    const auto& vb = evaluator.Variance()[original][channel];
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
  return repeated;
}

/// Mean over the channels of the same kind as `channel`: a motor that rested in the repeated runs and moves
/// in others is assumed to repeat no better than the others of its kind.
Repeated OthersOfKind(const std::vector<Repeated>& repeats, const std::vector<Channel>& channels,
                      const Channel& channel) {
  Repeated sum;
  for (std::size_t o = 0; o < channels.size(); ++o) {
    if (channels[o].cut != channel.cut || channels[o].quantity != channel.quantity) continue;
    if (!repeats[o].known()) continue;
    sum.ratio += repeats[o].ratio * repeats[o].windows;
    sum.square += repeats[o].square * repeats[o].windows;
    sum.windows += repeats[o].windows;
  }
  if (sum.windows > 0) sum.ratio /= sum.windows, sum.square /= sum.windows;
  return sum;
}

}  // namespace

void Evaluator::FindFloors(const DataSet& set, const Options& options) {
  FindWhiteNoise();
  FindVariances(set, options);
  MaskAfterUnrecordedMotion(options.threads);
  SubtractBefore();
  ScaleByRepetition(options);
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
  const int channels = static_cast<int>(channels_.size());
  const std::vector<int> originals = OriginalsOf(runs_);
  repeated_ = std::any_of(originals.begin(), originals.end(), [](int original) { return original >= 0; });
  std::vector<Repeated> repeats;
  for (int c = 0; c < channels; ++c) repeats.push_back(CompareRepetitions(*this, originals, c));
  repetitions_by_ = Eigen::VectorXd::Ones(channels);
  const Evaluator* other = options.with_cause;
  if (!options.repeats && other == nullptr) repeatability_ = FindRepeatability(*this, options);
  if (other != nullptr && !AlikeIn(*other))
    throw std::invalid_argument("with a cause, other places are measured");
  if (options.repeats || other != nullptr) repeats.assign(repeats.size(), {});
  int most_returns = 0;
  for (int c = 0; c < channels; ++c) {
    const Repeated& own = repeats[static_cast<std::size_t>(c)];
    const Repeated from = own.known() ? own : OthersOfKind(repeats, channels_, channels_[c]);
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
    ScaleVariance(c, scale, least, other);
    SetFloor(c, options);
  }
  if (other != nullptr) repetitions_by_ = other->repetitions_by_, repeatability_ = other->repeatability_;
  ReportRepetitions(most_returns);
}

void Evaluator::ScaleVariance(int channel, double scale, double least, const Evaluator* with_cause) {
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    auto& variance = variance_[i][channel];
    for (Eigen::Index w = 0; w < variance.size(); ++w) {
      double& v = variance[w];
      v = std::max(scale * v, least);
      if (!std::isfinite(v) || with_cause == nullptr) continue;
      const double theirs = with_cause->variance_[i][channel][w];
      if (std::isfinite(theirs)) v = std::max(v, theirs);
    }
    carried_[i][channel] *= scale;
  }
}

void Evaluator::SetFloor(int c, const Options& options) {
  std::vector<double> variances;
  for (const auto& run : variance_) {
    for (const double v : run[c]) {
      if (std::isfinite(v)) variances.push_back(v);
    }
  }
  Channel& channel = channels_[c];
  channel.floor = std::sqrt(std::max(Median(variances), channel.white * channel.white));
  channel.delta = std::hypot(kFloorShare * channel.floor, kSignalShare * Spread(channel));
  if (channel.quantity == Quantity::kTension && options.delta_N > 0) channel.delta = options.delta_N;
  if (channel.quantity == Quantity::kTipPosition && options.delta_m > 0) channel.delta = options.delta_m;
}

void Evaluator::ReportRepetitions(int most_returns) {
  int differs_most = 0;
  const double most = !channels_.empty() ? repetitions_by_.maxCoeff(&differs_most) : 1;
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
