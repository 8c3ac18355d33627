// A robot for a daemon in the same process: emulated drives and the plant on a bus in memory, its tracker and
// its fault orders on LCM as with tendril-plant. Knows nothing of the controller.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "tendril/can/can_port.h"
#include "tendril/core/clock.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::rig {

class SimulatedRobot {
 public:
  /// With the drives, their leads and the channels of the daemon's file; nodes pull the tendons that `robot`
  /// says. Throws as VirtualRig and io::OpenLcm do. `clock` must outlive the robot.
  SimulatedRobot(const RobotParameters& robot, const DaemonParameters& daemon, const Clock& clock,
                 std::uint64_t seed);
  ~SimulatedRobot();

  /// Moves the plant to the clock's time and lets the drives answer what was sent, once at each time; waiting
  /// on the port does the same. For the thread of the control loop, as the port.
  void Answer() noexcept;
  /// The daemon's end of the bus.
  can::CanPort& port();

  /// A line for each fault ordered since the last call, and for a plant that gave up; from any thread.
  std::vector<std::string> TakeLines();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::rig
