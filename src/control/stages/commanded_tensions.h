// The tensions commanded at the base. After a change of source they ramp to the new one, then follow it
// exactly. Knows nothing of what the source is.
#pragma once

#include <optional>

#include "tendril/control/tension_ramp.h"
#include "tendril/core/clock.h"
#include "tendril/core/robot.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::control {

class StateArchive;

class CommandedTensions {
 public:
  /// Tensions ramp at `rate_Nps`. `ramp`: for tensions from commands, where the drives' inertia limits them.
  CommandedTensions(const RobotParameters& robot, double rate_Nps, double period_s,
                    std::optional<TensionRamp> ramp);

  const TendonVector& tension_N() const noexcept { return tension_N_; }
  /// For pulls of bare motors, which have a ramp of their own.
  TendonVector& bare_pulls_N() noexcept { return tension_N_; }
  /// The tensions follow their source without the ramp.
  bool joined() const noexcept { return joined_; }
  bool none() const noexcept { return tension_N_ == none_N_; }
  /// At most the minimum tension is left, and no pair is pulled.
  bool Released() const noexcept;

  /// No torque, and the ramp's own rate.
  void Reset() noexcept;
  /// That of pairs is their pretension, which takes no torque.
  void SetToNone() noexcept { tension_N_ = none_N_; }
  /// The straight robot's tensions at rest.
  const TendonVector& rest_N() const noexcept { return rest_N_; }
  void SetToRest() noexcept { tension_N_ = rest_N_; }
  /// The source changes: the next Follow ramps.
  void Leave() noexcept { joined_ = false; }
  void Follow(const TendonVector& source_N) noexcept;
  /// One cycle towards tensions from a command; `starts`: the first one.
  void FollowCommand(const TendonVector& goal_N, bool starts) noexcept;
  /// One cycle down to no more than the minimum tension and no pull of pairs, at least fast enough to be
  /// there after `within_s`.
  void RampDown(std::optional<double> within_s) noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  bool RampTo(const TendonVector& goal_N) noexcept;
  TendonVector Goal() const noexcept;

  double min_tension_N_, own_rate_Nps_, period_s_;
  model::TendonPairs pairs_;
  TendonVector rest_N_;
  TendonVector none_N_;  // without torque
  std::optional<TensionRamp> ramp_;
  TendonVector tension_N_;
  double rate_Nps_;
  bool joined_ = false;
};

}  // namespace tendril::control
