// Scores a set of residuals: weights, mean squares by channel, log score, folds. Knows nothing of where
// residuals come from.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "evaluator.h"

namespace tendril::gap {

/// Residuals of one channel: those of `part` where it has the channel, else those of `rest`.
const Eigen::VectorXd& Pick(const Residuals& part, const Residuals& rest, int run, int channel);
/// `rest` with the channels of `part` replacing its own.
Residuals Completed(const Residuals& part, const Residuals& rest);

/// Parts of the data that are held out in turn: families of runs where there are at least three, else runs,
/// else intervals of time.
struct Folds {
  int count = 0;
  std::string by;  // what is held out: "kinds of motion", "runs", "quarters of the runs"
  std::vector<std::string> names;
  /// The fold of a window.
  int Of(int run, int window, int windows) const {
    if (!by_time) return of_run[run];
    return std::min(count - 1, window * count / std::max(windows, 1));
  }
  std::vector<int> of_run;
  bool by_time = false;
};
Folds MakeFolds(const std::vector<PreparedRun>& runs);

/// Weights of the log score. Residuals within a correlation time count once against the model discrepancy:
/// the weight of a window is 1 / (variance + m (delta^2 + leftover^2) + n distrust^2), with m the windows in
/// a correlation time and n those of the run.
class Weights {
 public:
  /// Sums of w j j' of some columns by fold, of each channel: computed once, and used by everything that adds
  /// these columns to others.
  class Products;

  Weights(const Evaluator& evaluator, const Eigen::VectorXd& leftover);
  /// Computes the products of these columns, which have to outlive the weights.
  void Multiply(const std::vector<const Residuals*>& columns, const Folds& folds);
  const Products* products() const { return products_.get(); }
  const Eigen::VectorXd& operator()(int run, int channel) const { return weight_[run][channel]; }
  /// The same with zero weight in the windows of a fold.
  Weights Without(const Folds& folds, int fold) const;

 private:
  Residuals weight_;
  std::shared_ptr<const Products> products_;
};

class Weights::Products {
 public:
  Products(const std::vector<const Residuals*>& columns, const Weights& weights, const Folds& folds);
  /// Its place here, or -1.
  int IndexOf(const Residuals* column) const;
  double At(int fold, int channel, int a, int b) const { return sums_[fold][channel](a, b); }
  double At(int channel, int a, int b) const {
    double sum = 0;
    for (const auto& fold : sums_) sum += fold[channel](a, b);
    return sum;
  }
  int channels() const { return static_cast<int>(sums_.front().size()); }

 private:
  std::vector<const Residuals*> columns_;
  std::vector<std::vector<Eigen::MatrixXd>> sums_;  // by fold and channel
};

/// Calls with fold, begin and length of each stretch of a run's windows that is in one fold.
template <class Call>
void ForEachStretch(const Folds& folds, int run, int windows, const Call& call) {
  if (!folds.by_time) {
    if (windows > 0) call(folds.of_run[run], 0, windows);
    return;
  }
  for (int f = 0, from = 0; f < folds.count; ++f) {
    int to = from;
    while (to < windows && folds.Of(run, to, windows) == f) ++to;
    if (to > from) call(f, from, to - from);
    from = to;
  }
}

/// Weight of a window of this variance in the mean square of its channel: windows with a large resolution
/// error, as where a motor breaks loose, contribute little.
inline double MeanWeight(double variance, const Channel& channel) {
  return 1 / (variance + channel.floor * channel.floor);
}

/// -1/2 sum of w r^2 over the channels of `part`; channels that it lacks are taken from `rest`.
double LogScore(const Weights& weights, const Residuals& part, const Residuals& rest);

/// Squares of a residual, window by window. Isolated windows that stand far above the rest are limited, so
/// that a few at a reversal do not decide; one of many in a row counts in full. `expected`: mean square of
/// the noise; `variance` is infinite in windows without a measurement.
Eigen::VectorXd CalmSquares(const Eigen::VectorXd& residual, const Eigen::VectorXd& variance,
                            const Eigen::VectorXd& expected, double window_s);

/// Mean squares per channel, of the residual and of what noise explains.
struct ChannelScore {
  Eigen::VectorXd square, noise;
  /// sqrt(square - slack noise), 0 below.
  double Excess(int channel, double slack = 1) const {
    return std::sqrt(std::max(0.0, square[channel] - slack * noise[channel]));
  }
};
ChannelScore ScoreChannels(const Evaluator& evaluator, const Residuals& part, const Residuals& rest);
/// Residual beyond the noise, by channel: models are not distinguished by less than that.
Eigen::VectorXd Leftover(const Evaluator& evaluator, const Residuals& part);
/// ScoreChannels of some runs.
ChannelScore ScoreChannels(const Evaluator& evaluator, const Residuals& part, const Residuals& rest,
                           const std::vector<int>& runs);

}  // namespace tendril::gap
