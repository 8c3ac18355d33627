// Free runs of the simulator: the recorded commands, and nothing else of a run. Knows nothing of hypotheses
// or verdicts.
#pragma once

#include <vector>

#include "evaluator.h"
#include "tendril/core/robot.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// The first run of every kind of motion whose torque targets and tip positions are recorded, from plants of
/// the nominal robot and of that `with_cause` (nullptr: none), beside each other on `threads` threads. Ends
/// where the nominal one cannot be simulated, or only slowly; where the other cannot, it is left out.
std::vector<FreeRun> FreeRuns(const Evaluator& evaluator, const RobotParameters* with_cause, int threads);

}  // namespace tendril::gap
