// In which direction each motor bends a robot, read from its postures before anything is learned: where the
// file says that it is unknown. Knows nothing of priors.
#pragma once

#include <string>
#include <vector>

#include "states.h"
#include "tendril/core/robot.h"

namespace tendril::gap {

/// Gives tendons whose `angle_rad` is unknown (within: unknown) the direction in which their motors move
/// their section's end past the section before, by linear regression on all motors. A line each tendon on
/// what was read, or why nothing could be.
std::vector<std::string> ReadDirections(const Postures& postures, RobotParameters& robot);

}  // namespace tendril::gap
