// A robot that its file describes only within the uncertainty of its numbers: these are learned from the
// runs, and every cause may adjust what the runs leave open. Knows nothing of causes or verdicts.
#pragma once

#include <optional>
#include <vector>

#include "evaluator.h"
#include "fit.h"
#include "learn.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

struct LearnedRobot {
  LearnedNumbers numbers;      // about the robot of the file
  Evaluator evaluator;         // of the same runs, its nominal robot with the numbers learned
  Eigen::MatrixXd directions;  // changes of the numbers by one unit of each of `open`, as columns
  Nuisances open;  // the directions that the runs say something about; priors are those of the file

  /// The numbers where a fit has adjusted them, by falling distance from the file in deviations of their
  /// priors.
  std::vector<LearnedNumber> At(const Fit* fit) const;
};

/// `numbers` were learned about the robot of `set`. Empty where that robot cannot be simulated.
std::optional<LearnedRobot> LearnRobot(LearnedNumbers numbers, const DataSet& set,
                                       const Evaluator::Options& evaluation);

/// Log evidence of numbers that are free within their priors over that of the file as it is: what they
/// explain, less what their freedom costs.
double LogEvidence(const Evaluator& evaluator, const LearnedNumbers& numbers);

/// The numbers beside that one of `causes` which explains most together with them, found from those learned
/// without a cause: these have moved to explain it. Empty where no cause explains enough more.
std::optional<LearnedNumbers> LearnBesideCause(const Evaluator& evaluator, const LearnedNumbers& alone,
                                               const std::vector<Model>& causes, const Folds& folds,
                                               const LearnOptions& options);

}  // namespace tendril::gap
