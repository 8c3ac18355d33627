// Whether runs differ from their repetitions by more than the sensors and a usual scatter of friction
// explain, or follow an angle in that: friction that peaks at angles, detents. Knows nothing of causes and
// verdicts.
#pragma once

#include <optional>
#include <string>

#include "evaluator.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Of the place that follows an angle, else of the one that differs most; nothing where runs repeat as well
/// as robots do, or none is repeated. `evaluator`: its variances are still those of the sensors alone.
std::optional<Repeatability> FindRepeatability(const Evaluator& evaluator, const Evaluator::Options& options);

/// What is to be said where no place has a gap, and what is added where one has.
std::string Unrepeated(const Repeatability& repeatability);
std::string ButUnrepeated(const Repeatability& repeatability);

}  // namespace tendril::gap
