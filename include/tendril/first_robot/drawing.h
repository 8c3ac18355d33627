// A robot file as a picture: what its numbers look like, for whoever wrote them. Knows nothing of files.
#pragma once

#include <string>

#include "tendril/core/robot.h"

namespace tendril::first_robot {

/// A whole SVG: side view (x to the right, z up, both of the base frame) of the straight robot, and of all
/// sections bent by limits.max_bending_rad the same way; disks, tendons, base, gravity, a scale bar.
std::string Drawing(const RobotParameters& robot);

}  // namespace tendril::first_robot
