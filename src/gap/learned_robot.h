// A robot that its file describes only within the uncertainty of its numbers: these are fitted to the runs,
// and every cause may adjust what the runs leave open. Knows nothing of verdicts.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "evaluator.h"
#include "fit.h"
#include "learn.h"
#include "tendril/core/robot.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

struct LearnedRobot {
  LearnedNumbers numbers;      // about the robot of the file
  RobotParameters robot;       // with them, and without the cause that they were found beside
  Eigen::MatrixXd directions;  // changes of the numbers by one unit of each of `open`, as columns
  Nuisances open;  // directions that the runs determine better than the file does, with the file's priors

  /// The numbers where a fit about `robot` has adjusted them, by falling distance from the file in deviations
  /// of their priors. Null: as they are in `robot`.
  std::vector<LearnedNumber> At(const Fit* fit) const;
};

/// `numbers` were found about the robot of `file`.
LearnedRobot RobotWith(LearnedNumbers numbers, const RobotParameters& file);

/// Log evidence of numbers that are free within their priors over that of the file as it is: what they
/// explain, less what their freedom costs.
double LogEvidence(const Evaluator& evaluator, const LearnedNumbers& numbers);

/// The numbers beside that one of `causes` which has the largest evidence together with them, begun from
/// those found without a cause: these have moved to explain it. Empty where none has more evidence than no
/// cause.
std::optional<LearnedNumbers> LearnBesideCause(const Evaluator& evaluator, const LearnedNumbers& alone,
                                               const std::vector<Model>& causes, const Folds& folds,
                                               const LearnOptions& options);

}  // namespace tendril::gap
