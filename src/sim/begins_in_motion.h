// Whether a log begins with the release of the robot or at rest. Knows nothing of replaying it.
#pragma once

#include "tendril/core/robot.h"
#include "tendril/sim/replay.h"

namespace tendril::sim {

/// Every simulation begins straight; where that is no equilibrium (tilt, rest bend, side load) the robot
/// moves at once, and motors and cells show it. A log that begins later begins at rest.
bool BeginsInMotion(const ReplaySignals& signals, const RobotParameters& robot);

}  // namespace tendril::sim
