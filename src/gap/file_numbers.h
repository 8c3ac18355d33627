// The numbers of the robot file as hypotheses: each may be wrong by any factor, a slip of the unit or of
// diameter for radius included. Knows nothing of effects or probabilities.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "fit.h"

namespace tendril::gap {

/// One number of the robot file, the same for all tendons or sections, or of one tendon.
struct FileNumber {
  std::string key;     // "actuation.gear.ratio", "body.tendon 2 angle_rad"
  double in_file = 0;  // its value there; the first one's where tendons or sections differ
  bool angle = false;  // changes by addition [rad]; else by a factor
  /// Changes it in a robot: by a factor exp(change), of an angle by change [rad].
  std::function<void(RobotParameters&, double change)> apply{};
  /// The effect of the library that is this number, which its own search has within its bounds; empty: none.
  std::string effect{};

  double ValueAt(double change) const;
};

/// Those of `robot` that a replay depends on. A value of zero is no number: a factor leaves it as it is.
std::vector<FileNumber> FileNumbers(const RobotParameters& robot);

/// A number at the value that explains the runs best.
struct NumberFit {
  FileNumber number;
  double value = 0;   // in its unit
  double score = 0;   // log score over all channels, nuisances free
  Residuals residuals;  // what it leaves, nuisances taken out
};

/// The best `count` of them by falling score, each refined on all runs; weights and nuisances as of the causes
/// they are compared with. `progress`: from 0 to 1.
std::vector<NumberFit> FitNumbers(const Evaluator& evaluator, const Weights& weights,
                                  const Nuisances& nuisances, const Folds& folds, int count, int threads,
                                  const std::function<void(double)>& progress);

}  // namespace tendril::gap
