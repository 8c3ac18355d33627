// The motors and tendons that a simulation needs, or why it cannot begin. Knows nothing of how they move.
#pragma once

#include <fmt/core.h>

#include <algorithm>
#include <stdexcept>

#include "tendril/core/robot.h"

namespace tendril::sim {

/// `who` needs them, for the error: "the plant". Throws std::invalid_argument where the robot has none, or
/// others than its body.
inline const ActuationParameters& Actuation(const RobotParameters& robot, const char* who) {
  if (!robot.actuation) {
    throw std::invalid_argument(
        fmt::format("robot '{}' has no actuation: {} needs motors and tendons; use a robot file with an "
                    "'actuation' section",
                    robot.name, who));
  }
  const int expected = robot.body.tendons();
  if (static_cast<int>(robot.actuation->tendons.size()) != expected) {
    throw std::invalid_argument(fmt::format("robot '{}': actuation names {} tendons, the body has {}",
                                            robot.name, robot.actuation->tendons.size(), expected));
  }
  return *robot.actuation;
}

/// Motor-side tension up to which the pulleys are tabulated. The motor's rated torque bounds its continuous
/// pull; this is twice the file's limit.
inline double TabulatedTo_N(const RobotParameters& robot) {
  return std::max(2 * robot.limits.max_tension_motor_N, 20.0);
}

}  // namespace tendril::sim
