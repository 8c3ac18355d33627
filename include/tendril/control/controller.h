// The tick: one cycle's feedback and command in, drive torques out. Flow order is file order:
// gate, inverse kinematics, trajectory, inverse dynamics, allocation, compensation, torque; estimator first.
// The one entry for the daemon, the in-process simulation and log replay; same input, same bits.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::control {

/// A shape is held by no more than this share of limits.max_tension_base_N: what friction and the body's own
/// swing add to what was wanted must have room below it.
inline constexpr double kLedShare = 0.9;

class Controller {
 public:
  /// Builds tables and workspaces; throws std::invalid_argument when the robot cannot be controlled (no
  /// actuation, sizes above the capacities of core/limits.h). `period_ns` is the cycle.
  Controller(const RobotParameters& robot, const ControllerParameters& parameters, TimeNs period_ns);
  ~Controller();

  /// One cycle. No allocation, lock, system call or unbounded loop.
  void Step(const CycleInput& input, CycleOutput& output) noexcept;

  /// How far ahead a sender has to be whose targets move, with trajectory.look_ahead: off.
  TimeNs look_ahead_ns() const noexcept;

  /// All that the next Step depends on beside its input, as bytes of this build; takes a few microseconds
  /// and allocates nothing. `bytes` has state_bytes() entries, which depend on robot and parameters only.
  std::size_t state_bytes() const noexcept;
  void SaveState(std::span<std::byte> bytes) const noexcept;
  /// From a controller of the same robot, parameters and period: every Step from here on gives the bits it
  /// would have given there. False when the bytes cannot be from such a controller; then this one must not
  /// be used any more.
  bool LoadState(std::span<const std::byte> bytes) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::control
