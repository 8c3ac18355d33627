// Scores a set of residuals: weights, mean squares by channel, log score, folds. Knows nothing of where
// residuals come from.
#pragma once

#include <Eigen/Core>
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
  Weights(const Evaluator& evaluator, const Eigen::VectorXd& leftover);
  const Eigen::VectorXd& operator()(int run, int channel) const { return weight_[run][channel]; }
  /// The same with zero weight in the windows of a fold.
  Weights Without(const Folds& folds, int fold) const;

 private:
  Residuals weight_;
};

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
