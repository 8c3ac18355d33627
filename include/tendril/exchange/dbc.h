// The bus as a CAN database (DBC), for bus monitors and other programs: every frame of daemon and drives,
// with values in units of the robot. Knows what the master maps, no port.
#pragma once

#include <span>
#include <string>

#include "tendril/canopen/drive_profile.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::exchange {

/// `drives` in tendon order, as the master gets them; the robot has actuation. Torques in N·m and angles in
/// rad at the motor shaft, pulling positive whichever way motor and encoder are mounted; load cells in N.
std::string Dbc(const RobotParameters& robot, const BusParameters& bus,
                std::span<const canopen::DriveSetup> drives);

}  // namespace tendril::exchange
