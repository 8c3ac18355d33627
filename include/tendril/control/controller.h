// One control cycle: feedback and command in, drive torques out. Stages in flow order: estimator, gate,
// inverse kinematics, trajectory, inverse dynamics, allocation, compensation, torque. The single entry for
// the daemon, the in-process simulation and log replay; the same input gives the same bits.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::control {

/// Reference shapes are held with at most this share of limits.max_tension_base_N; the rest is margin for
/// friction and for oscillation of the body.
inline constexpr double kCommandedTensionShare = 0.9;
/// The robot's limits, with that share as the largest base tension.
LimitParameters CommandedLimits(LimitParameters limits) noexcept;

struct LawRow;

class Controller {
 public:
  /// Builds tables and workspaces; throws std::invalid_argument when the robot cannot be controlled (no
  /// actuation, sizes above the capacities of core/limits.h). `period_ns` is the cycle.
  Controller(const RobotParameters& robot, const ControllerParameters& parameters, TimeNs period_ns);
  /// The same with a law of the caller's, whatever `parameters.law`.
  Controller(const RobotParameters& robot, const ControllerParameters& parameters, TimeNs period_ns,
             const LawRow& law);
  ~Controller();

  /// One cycle. No allocation, lock, system call or unbounded loop.
  void Step(const CycleInput& input, CycleOutput& output) noexcept;

  /// How far ahead of time a sender must place its moving targets when trajectory.look_ahead is off.
  TimeNs look_ahead_ns() const noexcept;

  /// The state that the next Step depends on beside its input, as bytes of this build. Takes a few
  /// microseconds and does not allocate. `bytes` has state_bytes() entries, a number that depends on robot
  /// and parameters only.
  std::size_t state_bytes() const noexcept;
  void SaveState(std::span<std::byte> bytes) const noexcept;
  /// Loads the state of a controller with the same robot, parameters and period; every Step from here on
  /// gives the same bits as there. Returns false when the bytes cannot come from such a controller; this
  /// controller must then be discarded.
  bool LoadState(std::span<const std::byte> bytes) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::control
