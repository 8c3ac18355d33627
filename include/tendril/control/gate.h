// The command gate: the only way in. Commands are distrusted: finite, of the right size, in range, fresh,
// newer than the last and fitting the mode, or refused with the reason. Knows nothing of how targets are
// reached.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

/// Of the robot's length: who asks for a tip that much farther away than the robot can be led means another
/// place.
inline constexpr double kOutOfReach = 0.1;

/// Longest that a moving target or a pull may hold: somebody must be there.
inline constexpr TimeNs kUnwatched_ns = 5 * kNsPerS;
/// Longest that anything may be valid.
inline constexpr TimeNs kLongestValid_ns = 3600 * kNsPerS;

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
  /// A sender of moving targets, or of one target after the other, leads until the last of them has expired
  /// (after a second at most), and one that commissions until that ends: another's targets are refused
  /// meanwhile. Single targets lead nothing, and anybody may ask for a mode. Sequence numbers are each
  /// sender's own.
  Status Admit(const Command& command, Mode mode, TimeNs now_ns, double away_m = 0) noexcept;
  /// Whether a command of this kind and request may act in this mode at all (else kCommandWrongMode).
  static bool AcceptedIn(Mode mode, const Command& command) noexcept;

  /// Whether a target was refused lately for being another sender's than those that lead.
  bool Contended(TimeNs now_ns) const noexcept { return now_ns < contended_until_ns_; }

  const Target& target() const noexcept { return target_; }
  /// Forgets the target: nothing is wanted until the next command, and nobody leads.
  void Drop() noexcept {
    target_.kind = CommandKind::kNone;
    leads_until_ns_ = 0;
  }

  void Remember(StateArchive& archive) noexcept;

 private:
  // What came last from one sender.
  struct Seen {
    bool any = false;
    std::uint64_t number = 0;
    TimeNs at_ns = std::numeric_limits<TimeNs>::min();
  };

  Status CheckValues(const Command& command, Mode mode) const noexcept;
  /// Of this command's sender; of one that is new in place of whom nothing was heard from for longest.
  Seen& LastOf(const Command& command) noexcept;

  int sections_, tendons_;
  double out_of_reach_m_, max_bending_rad_, max_tension_N_, default_speed_radps_, bare_pull_N_;
  std::array<Seen, 8> seen_;  // more than who operates one robot at a time
  // Sender and sequence of the last target, or of the request to commission, and of the last of another
  // sender before; and how long these targets are valid.
  std::uint64_t leader_ = 0, before_ = 0;
  TimeNs expires_ns_ = 0, before_expires_ns_ = 0;
  TimeNs leads_until_ns_ = 0, contended_until_ns_ = 0;
  Target target_;
};

}  // namespace tendril::control
