// Which mistake in measuring explains a gap: of all runs, or of one run beside the others. Knows of effects
// only that they are smaller.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Throws std::runtime_error where the time of all runs is in another unit than seconds: rows are too far
/// apart for a motion, motors go smoothly from row to row all the same, and the nominal robot leaves far less
/// of the runs once their time is taken in that unit than of states at rest.
void RefuseOtherTime(const DataSet& set);

/// What was most probably measured or declared wrong in all runs.
struct FoundMistake {
  std::string with;  // words that follow "with"; empty: nothing
  double left = 0;   // what the nominal robot leaves without it at the worst place, in floors
};
/// Nothing when undoing none of the mistakes takes away most of a gap, or the gap is no larger than effects
/// are. Of a gap that no effect explains the largest place counts, else all of them. `evaluator` is of `set`.
FoundMistake FindMistake(const DataSet& set, const Evaluator& evaluator, bool explained, int threads);

/// One run that was measured otherwise than the others.
struct OddRun {
  std::size_t run = 0;  // of the set
  std::string with;     // words that follow "with", as above
};
/// Runs that the model misses by far more than it does the others, and by far less once a mistake is undone
/// that the others were not made with. `missed` has the names of those that were looked at already, and
/// by how many times more than usual they are missed.
std::vector<OddRun> FindOddRuns(const DataSet& set, const Evaluator& evaluator,
                                std::map<std::string, double>& missed, int threads);

}  // namespace tendril::gap
