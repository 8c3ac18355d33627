// Checks whether a robot's tendons can perform a planned motion, before anything moves. Knows nothing of how
// it was planned.
#pragma once

#include "tendril/core/robot.h"
#include "tendril/motion/motion.h"

namespace tendril::motion {

/// Throws std::runtime_error with place and remedy where the motion's bendings need more base tension than
/// the control laws command, more motor-side tension than its limit, or more torque than the drives have:
/// Kane's equations of the arcs, the rotors' inertia and the friction of pulleys, gear and motor. Targets of
/// the tip are not checked.
void RequireTensions(const Motion& motion, const RobotParameters& robot);

}  // namespace tendril::motion
