// Positions of motors that pull two tendons. Knows nothing of models.
#pragma once

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// A motor that is recorded at one tendon of a pair only turns the other tendon's spool the opposite way.
/// Throws std::runtime_error where both are recorded and do not move like one motor.
void CompletePairs(const RobotParameters& robot, Run& run);

}  // namespace tendril::gap
