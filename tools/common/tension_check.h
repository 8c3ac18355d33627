// Whether a robot's tendons can lead a planned motion, before anything moves. Knows nothing of how it was
// planned.
#pragma once

#include "motion.h"
#include "tendril/core/robot.h"

namespace tendril::tools {

/// Throws std::runtime_error with place and remedy where the motion's bendings need more tension at the base
/// than laws lead a tendon to, more on the motor's side than its limit, or more torque than the drives have:
/// Kane's equations of the arcs, the rotors' inertia and the friction of pulleys, gear and motor. Targets of
/// the tip are not looked at.
void RequireTensions(const Motion& motion, const RobotParameters& robot);

}  // namespace tendril::tools
