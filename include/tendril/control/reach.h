// The bends that tendons can hold and the rates at which they can move there. Goals beyond are projected, and
// motions slowed, before they are commanded: when tensions saturate during a motion the rotors run on and
// jerk the tendons. Knows nothing of how motions are generated.
#pragma once

#include <optional>

#include "tendril/control/nearest_held.h"
#include "tendril/core/limits.h"
#include "tendril/core/robot.h"
#include "tendril/core/status.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::control {

class Reach {
 public:
  static constexpr double kRotorShare = 0.35, kLeastRoom = 0.03;

  /// `body`, that of `robot`, outlives this object; tensions are those of `limits`. A motion changes its rate
  /// by v at an acceleration of v / gather_s. A law without tension for the rotors' acceleration takes it
  /// from the minimum tension.
  Reach(const RobotParameters& robot, const model::Body& body, const LimitParameters& limits, double gather_s,
        bool pulls_for_rotors);

  /// kOk where the arcs of `bending_rad` can be held at rest; else kLimitedTensionMax, with `bending_rad`
  /// scaled down to the holdable bend. Without effect on a robot that cannot be held even straight. Where
  /// tendons do not pull in every direction, `bending_rad` is projected by NearestHeld.
  Status Limit(BendingVector& bending_rad) noexcept;
  /// With b the greatest bend of a section and S the bend that is holdable in every direction, the rate of
  /// bend [rad/s] is limited to
  ///   gather_s room / (rotor's inertia at the tendon x its lever),
  ///   room = max(1 - b / S, kLeastRoom) kRotorShare (T_max - T_min),
  /// so that rotors that start, stop or reverse take at most twice that room of a tendon. A law without
  /// tension for them lets them take at most T_min; that limit applies to resting goals only, since the
  /// sender of a moving goal determines its acceleration.
  double Rate_radps(const BendingVector& bending_rad, bool goal_moves) const noexcept;
  /// S: bend that sections hold in every direction, or in every direction that their tendons pull; 0 where
  /// not even the straight shape is holdable.
  double holdable_rad() const noexcept { return holdable_rad_; }
  /// The rate limit for commanded tensions, where no tension is added for the rotors.
  double CommandedTensionRate_radps() const noexcept { return rate_per_N_ * 0.5 * min_tension_N_; }

 private:
  /// Moments of the arcs' balance at rest that no tensions within the limits give; 0 where the bend is held.
  double Lacking_Nm(const BendingVector& bending_rad) noexcept;
  bool Holds(const BendingVector& bending_rad) noexcept { return Lacking_Nm(bending_rad) == 0; }
  /// The largest share that is held, from one that is `held` to 1, which lacks `lacking_Nm`.
  double HeldShare(const BendingVector& bending_rad, double lacking_Nm, double held) noexcept;
  void FindHoldable();
  void FindHoldableOfPulled();

  const model::Body& body_;
  model::TensionAllocator allocator_;
  std::optional<NearestHeld> nearest_;  // where tendons do not pull in every direction
  double min_tension_N_, max_tension_N_;
  double rate_per_N_ = 0, most_room_N_;
  double holdable_rad_ = 0;
  BendingVector asked_rad_, given_rad_;  // of the last call that searched
  UnitVector q_, unit_force_Nm_;
  BendingVector force_Nm_;
  Eigen::MatrixXd force_per_tension_;
};

}  // namespace tendril::control
