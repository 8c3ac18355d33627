// From the target to the reference: goal by inverse kinematics, projected onto what tensions hold, then the
// jerk-limited trajectory towards it. Knows nothing of how tensions follow.
#pragma once

#include "commanded_tensions.h"
#include "tendril/control/gate.h"
#include "tendril/control/reach.h"
#include "tendril/control/trajectory.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::control {

class StateArchive;

class ReferenceMotion {
 public:
  /// The nearest tip that the robot's arcs reach and its tensions hold.
  struct NearestTip {
    BendingVector bending_rad;
    Eigen::Vector3d tip_W_m;
    double distance_m;
    Status reached, held;
  };

  /// `body`, that of `robot`, outlives this object; shapes are held with tensions of `limits`.
  /// `feeds_forward` as in LawRow; torques then follow the reference by `actuation_delay_ns`.
  ReferenceMotion(const RobotParameters& robot, const ControllerParameters& parameters,
                  const model::Body& body, const LimitParameters& limits, TimeNs period_ns,
                  bool feeds_forward, TimeNs actuation_delay_ns);

  struct Cycle {
    TimeNs time_ns;
    bool running;         // targets are followed
    bool controls_shape;  // the reference moves; else it comes to rest
  };
  /// One cycle: sets the target's and the reference's fields of `output`. Leaves the tensions' source where
  /// tensions were commanded before.
  void Follow(const Cycle& cycle, const Target& target, CommandedTensions& tensions,
              CycleOutput& output) noexcept;

  NearestTip NearestTo(const Eigen::Vector3d& tip_W_m) noexcept;

  /// At rest at `bending_rad`.
  void Reset(const BendingVector& bending_rad) noexcept { trajectory_.Reset(bending_rad); }
  /// The next reference is a new one, whatever was commanded before.
  void Restart() noexcept { source_ = CommandKind::kNone; }
  /// Tensions are commanded, not a shape.
  bool tension_commanded() const noexcept { return source_ == CommandKind::kTension; }
  /// In this cycle the tensions' source changed between shape and commands.
  bool switched() const noexcept { return switched_; }

  /// How far ahead of the present the goal is taken.
  TimeNs ahead_ns() const noexcept { return trajectory_.delay_ns() + actuation_delay_ns_; }
  double gather_s() const noexcept { return trajectory_.gather_s(); }
  /// Rate limit of the bend under commanded tensions.
  double CommandedTensionRate_radps() const noexcept { return reach_.CommandedTensionRate_radps(); }

  void Archive(StateArchive& archive) noexcept;

 private:
  void Approach(TimeNs time_ns, const Target& target, bool same_source, CycleOutput& output) noexcept;
  void GoalOfTip(TimeNs time_ns, TimeNs at_ns, const Target& target, CycleOutput& output) noexcept;
  void GoalOfBending(TimeNs at_ns, const Target& target, CycleOutput& output) noexcept;

  int sections_;
  double period_s_, max_bending_rad_;
  double tolerance_m_;  // a tip target this close to the reachable set counts as reachable
  bool look_ahead_, feeds_forward_;
  TimeNs actuation_delay_ns_;
  model::InverseKinematics kinematics_;
  Trajectory trajectory_;
  Reach reach_;

  CommandKind source_ = CommandKind::kNone;
  bool switched_ = false;  // in this cycle
  bool waits_ = false;     // for tensions that ramp from commanded ones
  BendingVector goal_rad_, goal_rate_radps_;
};

}  // namespace tendril::control
