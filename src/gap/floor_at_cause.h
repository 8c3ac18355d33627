// The floor as it is with a cause in the robot: it may make more of the sensors' noise that drives it than
// the nominal robot, and the floor is higher; less, and it fits better without explaining anything; and it
// may make repetitions differ that the nominal robot would repeat.
#pragma once

#include <optional>

#include "evaluator.h"
#include "search.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// The runs with the floor as it is with the best single cause, where that is plainly higher than with the
/// nominal robot. Nothing where no cause is found, or where its misfit could pass for noise: without
/// repetitions the floor follows what a robot leaves.
std::optional<Evaluator> WidenedByCause(const Evaluator& evaluator, const DataSet& set,
                                        const SearchResult& search, const Evaluator::Options& options);

/// The runs with the floor that repetitions leave with the best single cause, where they differ by much and
/// by plainly less with it: a motor that cogs, and stops elsewhere each time, does not repeat, and how it
/// does not is no noise. Nothing where no cause is found.
std::optional<Evaluator> NarrowedByCause(const Evaluator& evaluator, const DataSet& set,
                                         const SearchResult& search, const Evaluator::Options& options);

/// Takes off the scores of the best single causes, and of the best pairs, what they gain by carrying less
/// noise than the nominal robot does: half the weight of the variance that is missing. Cells between pulleys
/// and robot shake the simulated body with their noise; one that is damped twice as much stays calmer, and
/// nearer to what was measured, whatever the real damping is.
void TakeOffQuiet(const Evaluator& evaluator, const DataSet& set, const Evaluator::Options& options,
                  SearchResult& search);

}  // namespace tendril::gap
