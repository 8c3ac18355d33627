// Whether repetitions differ by more than the sensors and the usual scatter of friction explain, or differ as
// a function of an angle (friction peaks, detents). Knows nothing of causes and verdicts.
#pragma once

#include <optional>
#include <string>

#include "evaluator.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// For the place whose differences follow an angle, else for the one with the largest differences; empty
/// where runs repeat as well as robots do, or none is repeated. The variances of `evaluator` must be those of
/// the sensors alone.
std::optional<Repeatability> FindRepeatability(const Evaluator& evaluator, const Evaluator::Options& options);

/// The sentence where no place has a gap, and the one added where a place has one.
std::string Unrepeated(const Repeatability& repeatability);
std::string UnrepeatedRemark(const Repeatability& repeatability);

}  // namespace tendril::gap
