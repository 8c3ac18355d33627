// Which robot a simulation has behind its drives. Knows nothing of the simulation.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::rig {

/// The robot of `plant_file`, or without one the controller's (with actuation), wired as the daemon's `bus`
/// says; with `effects` in the form of sim::ParseEffect added. Throws std::runtime_error when it has another
/// number of tendons than the controller's, and what sim::LoadRobot, ParseEffect and CheckEffects throw.
RobotParameters PlantOf(const RobotParameters& controllers, const BusParameters& bus,
                        const std::string& plant_file, const std::vector<std::string>& effects);

}  // namespace tendril::rig
