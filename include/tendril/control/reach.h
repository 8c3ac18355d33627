// How far tendons can hold a robot bent, and how fast they can lead it there: a goal beyond that is brought
// back, and a motion slowed, before anything is led. A robot that tensions stop on its way keeps going with
// its rotors, and snatches its tendons. Knows nothing of how motions are made.
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
  /// by v at an acceleration of v / gather_s; a law that does not pull for its rotors leaves them to the
  /// least tension.
  Reach(const RobotParameters& robot, const model::Body& body, const LimitParameters& limits, double gather_s,
        bool pulls_for_rotors);

  /// kOk where the arcs of `bending_rad` can be held at rest; else kLimitedTensionMax, and `bending_rad` is
  /// scaled down to where they can. A robot that cannot even be held straight is left alone. Where tendons do
  /// not pull every way `bending_rad` is brought as NearestHeld says.
  Status Limit(BendingVector& bending_rad) noexcept;
  /// With b the greatest bend of a section and S the one that is held whatever its direction, rates of bend
  /// up to
  ///   gather_s room / (rotor's inertia at the tendon x its lever),
  ///   room = max(1 - b / S, kLeastRoom) kRotorShare (T_max - T_min),
  /// at which rotors that start, stop or turn round take at most twice that room of a tendon; without a pull
  /// for them at most T_min [rad/s]; that last only where the goal stands, for whoever sends a moving one has
  /// chosen how it gathers speed.
  double Rate_radps(const BendingVector& bending_rad, bool goal_moves) const noexcept;
  /// S: bent by no more than this, sections are held in every direction, or every one into which their
  /// tendons pull; 0 where not even straight.
  double sure_rad() const noexcept { return sure_rad_; }
  /// The same where nothing is pulled for rotors: tensions that are commanded.
  double UnpulledRate_radps() const noexcept { return rate_per_N_ * 0.5 * min_tension_N_; }

 private:
  bool Holds(const BendingVector& bending_rad) noexcept;
  void FindSure();
  void FindSureOfPulled();

  const model::Body& body_;
  model::TensionAllocator allocator_;
  std::optional<NearestHeld> nearest_;  // where tendons do not pull every way
  double min_tension_N_, max_tension_N_;
  double rate_per_N_ = 0, most_room_N_;
  double sure_rad_ = 0;
  BendingVector asked_rad_, given_rad_;  // of the last call that had to look for it
  UnitVector q_, unit_force_Nm_;
  BendingVector force_Nm_;
  Eigen::MatrixXd force_per_tension_;
};

}  // namespace tendril::control
