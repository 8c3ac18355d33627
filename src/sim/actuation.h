// The motors and tendons that a simulation needs, or why it cannot begin. Knows nothing of how they move.
#pragma once

#include <fmt/core.h>

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

}  // namespace tendril::sim
