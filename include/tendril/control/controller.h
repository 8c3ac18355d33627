// The tick: one cycle's feedback and command in, drive torques out. Flow order is file order:
// gate, inverse kinematics, trajectory, inverse dynamics, allocation, compensation, torque; estimator first.
// The one entry for the daemon, the in-process simulation and log replay; same input, same bits.
#pragma once

#include <memory>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class Controller {
 public:
  /// Builds tables and workspaces; throws std::invalid_argument when the robot cannot be controlled (no
  /// actuation, sizes above the capacities of core/limits.h). `period_ns` is the cycle.
  Controller(const RobotParameters& robot, const ControllerParameters& parameters, TimeNs period_ns);
  ~Controller();

  /// One cycle. No allocation, lock, system call or unbounded loop.
  void Step(const CycleInput& input, CycleOutput& output) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::control
