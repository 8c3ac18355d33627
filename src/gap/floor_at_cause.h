// The floor as it is with a cause in the robot: it may make more of the sensors' noise that drives it than
// the nominal robot, and the floor is higher; less, and it fits better without explaining anything; and it
// may make repetitions differ that the nominal robot would repeat.
#pragma once

#include <optional>
#include <vector>

#include "evaluator.h"
#include "search.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// The runs with the floor as it is with the best single cause, where that is plainly higher than with the
/// nominal robot. Nothing where no cause is found, or where its misfit could pass for noise: without
/// repetitions the floor follows what a robot leaves.
std::optional<Evaluator> WidenedByCause(const Evaluator& evaluator, const DataSet& set,
                                        const SearchResult& search, const Evaluator::Options& options);

/// The runs as though they repeated as well as the sensors' noise lets them: what makes repetitions differ is
/// looked for in these.
Evaluator AsThoughRepeated(const DataSet& set, const Evaluator::Options& options);

/// Repetitions differ by as much as may hide a cause.
bool MayHide(const Evaluator& evaluator);

/// What of these may make repetitions differ: the best singles and pairs.
std::vector<Model> MayNotRepeat(const SearchResult& search);

/// The runs with the floor that they have with one of `causes`, and which.
struct Narrowed {
  Evaluator evaluator;
  Model cause;
  double differed;  // times the sensors' noise, of the worst channel that repeats plainly better with it
};
/// Where repetitions differ, and at some place by plainly less with a cause, the one that leaves the lowest
/// floors: a motor that cogs, and stops elsewhere each time, does not repeat, and how it does not is no
/// noise. The floor is then that of the robot with the cause: repetitions, and what it makes of the sensors'
/// noise.
std::optional<Narrowed> NarrowedByCause(const Evaluator& evaluator, const DataSet& set,
                                        const std::vector<Model>& causes, const Evaluator::Options& options);

/// Takes off the scores of the best single causes, and of the best pairs, what they gain by carrying less
/// noise than the nominal robot does: half the weight of the variance that is missing. Cells between pulleys
/// and robot shake the simulated body with their noise; one that is damped twice as much stays calmer, and
/// nearer to what was measured, whatever the real damping is.
void TakeOffQuiet(const Evaluator& evaluator, const DataSet& set, const Evaluator::Options& options,
                  SearchResult& search);

}  // namespace tendril::gap
