// The noise floor of a robot that has a cause. The cause may amplify the sensor noise that drives the model,
// which raises the floor; reduce it, which improves the fit without explaining anything; or make repetitions
// differ that the nominal robot would repeat.
#pragma once

#include <optional>
#include <vector>

#include "evaluator.h"
#include "search.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// The runs with the floor of the best single cause, where it is clearly higher than that of the nominal
/// robot. Empty where no cause is found, or where its misfit could be mistaken for noise: without repetitions
/// the floor depends on the residuals.
std::optional<Evaluator> WithFloorOfCause(const Evaluator& evaluator, const DataSet& set,
                                          const SearchResult& search, const Evaluator::Options& options);

/// The runs with repeatability assumed to be limited by sensor noise only, for finding what makes repetitions
/// differ.
Evaluator AsThoughRepeated(const DataSet& set, const Evaluator::Options& options);

/// Repetitions differ by enough to hide a cause.
bool MayHideCause(const Evaluator& evaluator);

/// The candidates that may make repetitions differ: the best singles and pairs.
std::vector<Model> MayNotRepeat(const SearchResult& search);

/// The runs with the floor of one of `causes`, and which one.
struct Narrowed {
  Evaluator evaluator;
  Model cause;
  double
      differed;  // in units of sensor noise, of the worst channel that repeats clearly better with the cause
};
/// Where repetitions differ, and clearly less with a cause, the cause that gives the lowest floors. Example:
/// a motor with cogging stops at different angles, so its runs do not repeat, but that difference is not
/// noise. The floor is then that of the robot with the cause, from its repetitions and its amplification of
/// sensor noise.
std::optional<Narrowed> WithRepeatabilityOfCause(const Evaluator& evaluator, const DataSet& set,
                                                 const std::vector<Model>& causes,
                                                 const Evaluator::Options& options);

/// Subtracts from the scores of the best single causes and pairs what they gain by carrying less noise than
/// the nominal robot: half the weight of the missing variance. Example: load cells between pulleys and robot
/// drive the simulated body with their noise; doubling its damping calms it and fits better, whatever the
/// real damping is.
void SubtractNoiseGain(const Evaluator& evaluator, const DataSet& set, const Evaluator::Options& options,
                       SearchResult& search);

}  // namespace tendril::gap
