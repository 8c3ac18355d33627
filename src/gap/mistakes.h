// Mistakes in how a robot was measured that look like a gap larger than any effect makes: a sign, an order, a
// side, a unit, a delay. Each is undone to see whether the gap goes. Knows nothing of effects.
#pragma once

#include <string>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// What was most probably measured or declared wrong in all runs, as words that follow "with"; empty when
/// undoing none of them takes away most of a gap, or the gap is no larger than effects are. `evaluator` is of
/// `set`.
std::string FindMistake(const DataSet& set, const Evaluator& evaluator, int threads);

/// Rows [from, to) of a run in which a motor position keeps one value though the motor turned: its tension
/// changes, and not as the tendon's stretch says of a motor that stands.
struct FrozenMotor {
  std::size_t run = 0;
  Eigen::Index tendon = 0, from = 0, to = 0;
  double tension_N = 0;  // by which it changes
};
std::vector<FrozenMotor> FindFrozenMotors(const DataSet& set, const Evaluator& evaluator);

/// One run that was measured otherwise than the others.
struct OddRun {
  std::size_t run = 0;  // of the set
  std::string with;     // words that follow "with", as above
};
/// Runs that the model fits far worse than it does the others, and as well once one mistake is undone.
std::vector<OddRun> FindOddRuns(const DataSet& set, const Evaluator& evaluator, int threads);

}  // namespace tendril::gap
