// From configuration to drive set-ups: which drive on the bus pulls which tendon, and with which motor. Plain
// conversions, shared by the daemon and the in-process demo; opens nothing.
#pragma once

#include <vector>

#include "tendril/canopen/master.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/io/gateway.h"

namespace tendril::daemon {

/// One setup per tendon, in tendon order: node ids and profiles from the daemon's file, currents [mA], torque
/// constant [uN m/A] and rated torque [uN m] from the robot's. Reads the EDS files that bus.nodes name.
/// Throws std::invalid_argument when the robot has no actuation, a tendon has no node, or a drive's EDS file
/// is none or lacks what the daemon needs.
std::vector<canopen::DriveSetup> DriveSetups(const RobotParameters& robot, const BusParameters& bus);

io::RobotShape ShapeOf(const RobotParameters& robot);

}  // namespace tendril::daemon
