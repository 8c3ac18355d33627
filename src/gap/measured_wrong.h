// Which measurement error explains a gap: of all runs, or of one run compared with the others. Knows of
// effects only that they are smaller.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Throws std::runtime_error where the time of all runs is not in seconds: rows are too far apart for a
/// motion although motors move smoothly between them, and the nominal robot leaves far smaller residuals once
/// the time is converted than when the rows are taken as states at rest.
void RefuseOtherTime(const DataSet& set);

/// The most probable measurement or declaration error in all runs.
struct FoundMistake {
  std::string with;  // phrase that follows "with"; empty: none found
  double left = 0;   // residual of the nominal robot at the worst place once the error is undone, in floors
};
/// Empty when undoing none of the errors removes most of a gap, or when the gap is no larger than effects
/// are. For a gap that no effect explains the largest place counts, otherwise all places. `evaluator` is that
/// of `set`.
FoundMistake FindMistake(const DataSet& set, const Evaluator& evaluator, bool explained, int threads);

/// A run that was measured differently from the others.
struct DeviatingRun {
  std::size_t run = 0;  // index in the set
  std::string with;     // phrase that follows "with", as above
};
/// Runs with a far larger model error than the others, which falls by far once a measurement error is undone
/// that the others do not have. `missed` holds the names of the runs examined so far and the ratio of their
/// model error to the usual one.
std::vector<DeviatingRun> FindDeviatingRuns(const DataSet& set, const Evaluator& evaluator,
                                            std::map<std::string, double>& missed, int threads);

}  // namespace tendril::gap
