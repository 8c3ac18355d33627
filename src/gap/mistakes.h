// Mistakes in how a robot was measured that look like a gap larger than any effect makes: a sign, an order, a
// side. Each is undone on some of the runs, to see whether the gap goes. Knows nothing of effects.
#pragma once

#include <string>

#include "evaluator.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// What was most probably measured or declared wrong, as words that follow "with"; empty when undoing none of
/// them takes away most of a gap, or the gap is no larger than effects are. `evaluator` is of `set`.
std::string FindMistake(const DataSet& set, const Evaluator& evaluator, int threads);

}  // namespace tendril::gap
