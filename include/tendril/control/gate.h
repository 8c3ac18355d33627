// The command gate: the only way in. Commands are distrusted: finite, of the right size, in range, fresh,
// newer than the last and fitting the mode, or refused with the reason. Knows nothing of how targets are
// reached.
#pragma once

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

/// Of the robot's length: who asks for a tip that much farther away than the robot can be led means another
/// place.
inline constexpr double kOutOfReach = 0.1;

/// What is wanted right now, after the gate. A moving target moves on with its velocity until it expires.
struct Target {
  CommandKind kind = CommandKind::kNone;  // kTip, kBending or kTension once there is one
  TimeNs since_ns = 0;                    // when it was received
  TimeNs valid_for_ns = 0;
  Eigen::Vector3d tip_W_m{0, 0, 0}, tip_velocity_W_mps{0, 0, 0};
  BendingVector bending_rad, bending_rate_radps;
  TendonVector tension_N;
  // By which the velocity changed from the command before, of a stream of moving targets; zero or empty
  // otherwise.
  Eigen::Vector3d tip_acceleration_W_mps2{0, 0, 0};
  BendingVector bending_acceleration_radps2;
  double speed_radps = 0;

  /// Seconds the target has moved on at time t: never before it came, never past its validity.
  double ElapsedS(TimeNs t_ns) const noexcept;
  bool moving() const noexcept;
  Eigen::Vector3d TipAt(TimeNs t_ns) const noexcept { return tip_W_m + tip_velocity_W_mps * ElapsedS(t_ns); }
};

class CommandGate {
 public:
  /// `bare_pull_N`: what commissioning may ask of a motor, either way.
  CommandGate(const RobotParameters& robot, double default_speed_radps, double bare_pull_N);

  /// Ok when the command may act in this mode, else why not. An accepted target replaces the current one.
  /// A disarm is accepted however old it is and whatever came before it. `away_m` is how far a commanded tip
  /// is from the nearest point that the robot can be led to: up to kOutOfReach is admitted.
  Status Admit(const Command& command, Mode mode, TimeNs now_ns, double away_m = 0) noexcept;

  const Target& target() const noexcept { return target_; }
  /// Forgets the target: nothing is wanted until the next command.
  void Drop() noexcept { target_.kind = CommandKind::kNone; }

  void Remember(StateArchive& archive) noexcept;

 private:
  Status CheckValues(const Command& command, Mode mode) const noexcept;

  int sections_, tendons_;
  double out_of_reach_m_, max_bending_rad_, max_tension_N_, default_speed_radps_, bare_pull_N_;
  bool any_ = false;
  std::uint32_t last_sequence_ = 0;
  TimeNs last_seen_ns_ = 0;
  Target target_;
};

}  // namespace tendril::control
