// The command gate, through which every command passes. A command must be finite, of the right size, in
// range, fresh, newer than the last one and allowed in the mode; otherwise it is refused with the reason.
// Knows nothing of how targets are reached.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

/// Share of the robot's length. A tip target farther than this from the reachable set is refused as a
/// mistake.
inline constexpr double kOutOfReach = 0.1;

/// Longest validity of a moving target or a bare pull, which would otherwise act on without its sender.
inline constexpr TimeNs kLongestUnattended_ns = 5 * kNsPerS;
/// Longest validity of any command.
inline constexpr TimeNs kLongestValid_ns = 3600 * kNsPerS;

/// The current target, as admitted by the gate. A moving target advances with its velocity until it expires.
struct Target {
  CommandKind kind = CommandKind::kNone;  // kTip, kBending or kTension once there is one
  TimeNs since_ns = 0;                    // when it was received
  TimeNs valid_for_ns = 0;
  Eigen::Vector3d tip_W_m{0, 0, 0}, tip_velocity_W_mps{0, 0, 0};
  BendingVector bending_rad, bending_rate_radps;
  TendonVector tension_N;
  // Finite difference of the velocity between two commands of a stream of moving targets; else zero or empty.
  Eigen::Vector3d tip_acceleration_W_mps2{0, 0, 0};
  BendingVector bending_acceleration_radps2;
  double speed_radps = 0;

  /// Seconds that the target has moved at time t, between its arrival and the end of its validity.
  double ElapsedS(TimeNs t_ns) const noexcept;
  bool moving() const noexcept;
  Eigen::Vector3d TipAt(TimeNs t_ns) const noexcept { return tip_W_m + tip_velocity_W_mps * ElapsedS(t_ns); }
};

class CommandGate {
 public:
  /// `bare_pull_N`: largest pull of a motor in commissioning, in either direction.
  CommandGate(const RobotParameters& robot, double default_speed_radps, double bare_pull_N);

  /// kOk when the command may act in this mode, else the reason for the refusal. An accepted target replaces
  /// the current one. A disarm is accepted whatever its age and order. `away_m` is the distance of a
  /// commanded tip from the nearest holdable point; up to kOutOfReach is admitted. A sender that streams
  /// targets stays in control until the last of them expires (at most a second), a sender that commissions
  /// until commissioning ends; targets of other senders are refused meanwhile. Single targets reserve no
  /// control, and any sender may request a mode. Each sender numbers its own commands.
  Status Admit(const Command& command, Mode mode, TimeNs now_ns, double away_m = 0) noexcept;
  /// Whether a command of this kind and request may act in this mode at all (else kCommandWrongMode).
  static bool AcceptedIn(Mode mode, const Command& command) noexcept;

  /// Whether a target was refused lately because another sender is in control.
  bool Contended(TimeNs now_ns) const noexcept { return now_ns < contended_until_ns_; }

  const Target& target() const noexcept { return target_; }
  /// Drops the target and the sender's control until the next command.
  void Drop() noexcept {
    target_.kind = CommandKind::kNone;
    in_control_until_ns_ = 0;
  }

  void Archive(StateArchive& archive) noexcept;

 private:
  // The last command of one sender.
  struct LastCommand {
    bool any = false;
    std::uint64_t number = 0;
    TimeNs at_ns = std::numeric_limits<TimeNs>::min();
  };

  Status CheckValues(const Command& command, Mode mode) const noexcept;
  /// The entry of this command's sender; for a new sender, the entry with the oldest command is replaced.
  LastCommand& LastFrom(const Command& command) noexcept;

  int sections_, tendons_;
  double out_of_reach_m_, max_bending_rad_, max_tension_N_, default_speed_radps_, bare_pull_N_;
  std::array<LastCommand, 8> last_commands_;  // more senders than operate one robot at a time
  // Sender and sequence of the last target or commissioning request, and of the last one of a different
  // sender before it, with the expiry of their targets.
  std::uint64_t in_control_ = 0, previous_ = 0;
  TimeNs expires_ns_ = 0, previous_expires_ns_ = 0;
  TimeNs in_control_until_ns_ = 0, contended_until_ns_ = 0;
  Target target_;
};

}  // namespace tendril::control
