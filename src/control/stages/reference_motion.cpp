#include "reference_motion.h"

#include <algorithm>
#include <limits>

#include "../report.h"
#include "tendril/control/state_archive.h"

namespace tendril::control {

ReferenceMotion::ReferenceMotion(const RobotParameters& robot, const ControllerParameters& parameters,
                                 const model::Body& body, const LimitParameters& limits, TimeNs period_ns,
                                 bool feeds_forward, TimeNs actuation_delay_ns)
    : sections_(body.sections()),
      period_s_(ToSeconds(period_ns)),
      max_bending_rad_(robot.limits.max_bending_rad),
      tolerance_m_(1e-3 * robot.body.length_m()),
      look_ahead_(parameters.trajectory.look_ahead),
      feeds_forward_(feeds_forward),
      actuation_delay_ns_(actuation_delay_ns),
      kinematics_(body, robot.limits.max_bending_rad),
      trajectory_(sections_, parameters.trajectory, robot.limits.max_bending_rad, period_ns),
      reach_(robot, body, limits, trajectory_.gather_s(), feeds_forward),
      goal_rad_(BendingVector::Zero(2 * sections_)),
      goal_rate_radps_(goal_rad_) {}

ReferenceMotion::NearestTip ReferenceMotion::NearestTo(const Eigen::Vector3d& tip_W_m) noexcept {
  const model::IkSolution ik = kinematics_.Solve(tip_W_m, goal_rad_);
  NearestTip nearest{ik.us_vs, ik.tip_W_m, ik.distance_m, ik.status, Status::kOk};
  nearest.held = reach_.Limit(nearest.bending_rad);
  if (nearest.held != Status::kOk) {
    nearest.tip_W_m = kinematics_.Tip(nearest.bending_rad);
    nearest.distance_m = (nearest.tip_W_m - tip_W_m).norm();
  }
  return nearest;
}

void ReferenceMotion::Follow(const Cycle& cycle, const Target& target, CommandedTensions& tensions,
                             CycleOutput& output) noexcept {
  output.target_tip_W_m.setConstant(std::numeric_limits<double>::quiet_NaN());
  const CommandKind before = source_;
  if (cycle.running && target.kind != CommandKind::kNone) source_ = target.kind;
  switched_ = (before == CommandKind::kTension) != tension_commanded();
  if (switched_ && !tension_commanded() && cycle.controls_shape) {
    trajectory_.Reset(output.bending_estimate_rad);  // back from tension control: start where the robot is
    tensions.Leave();
    waits_ = true;
  }
  if (tensions.joined() || !cycle.controls_shape || tension_commanded()) waits_ = false;

  if (!cycle.controls_shape || target.kind == CommandKind::kNone || target.kind == CommandKind::kTension) {
    goal_rate_radps_.setZero();
    trajectory_.AdvanceToRest();
    goal_rad_ = trajectory_.followed();
  } else {
    Approach(cycle.time_ns, target, before == source_, output);
  }
  output.target_bending_rad = goal_rad_;
  output.reference = trajectory_.reference();
}

// The goal is taken ahead by the delay of the trajectory's averages, so that a moving target is followed
// without lag.
void ReferenceMotion::Approach(TimeNs time_ns, const Target& target, bool same_source,
                               CycleOutput& output) noexcept {
  const TimeNs at_ns = time_ns + (look_ahead_ ? ahead_ns() : 0);
  const BendingVector goal_before = goal_rad_;
  if (target.kind == CommandKind::kTip) {
    GoalOfTip(time_ns, at_ns, target, output);
  } else {
    GoalOfBending(at_ns, target, output);
  }
  // Rate of the goal itself; a goal replaced by a new command jumps and has none.
  const bool continued = target.moving() && same_source && target.since_ns + period_s_ * 1e9 < time_ns;
  if (continued) {
    goal_rate_radps_ = (goal_rad_ - goal_before) / period_s_;
  } else if (!target.moving()) {
    goal_rate_radps_.setZero();
  }
  // Tensions still ramp to those that hold this shape, so the reference waits.
  if (waits_) {
    trajectory_.AdvanceToRest();
  } else {
    Report(output, trajectory_.Advance(goal_rad_, goal_rate_radps_, target.speed_radps,
                                       reach_.Rate_radps(trajectory_.followed(), target.moving())));
  }
  if (target.moving() && time_ns - target.since_ns > target.valid_for_ns)
    Report(output, Status::kCommandExpired);
}

void ReferenceMotion::GoalOfTip(TimeNs time_ns, TimeNs at_ns, const Target& target,
                                CycleOutput& output) noexcept {
  const double smoothing_s2 = feeds_forward_ ? trajectory_.smoothing_s2() : 0;
  output.target_tip_W_m = target.TipAt(time_ns);
  const Eigen::Vector3d smoothed_W_m = smoothing_s2 * target.tip_acceleration_W_mps2;
  const NearestTip nearest = NearestTo(target.TipAt(at_ns) - smoothed_W_m);
  goal_rad_ = nearest.bending_rad;
  // Distance caused by look-ahead and smoothing alone is not reported.
  const double own_m = smoothed_W_m.norm();
  output.target_distance_m = std::max(0.0, nearest.distance_m - own_m);
  if (nearest.reached != Status::kTargetUnreachable || nearest.distance_m > tolerance_m_ + own_m)
    Report(output, nearest.reached);
  Report(output, nearest.held);
}

void ReferenceMotion::GoalOfBending(TimeNs at_ns, const Target& target, CycleOutput& output) noexcept {
  const double smoothing_s2 = feeds_forward_ ? trajectory_.smoothing_s2() : 0;
  goal_rad_ = target.bending_rad;
  if (target.moving()) goal_rad_ += target.bending_rate_radps * target.ElapsedS(at_ns);
  if (target.bending_acceleration_radps2.size() == goal_rad_.size())
    goal_rad_ -= smoothing_s2 * target.bending_acceleration_radps2;
  for (int k = 0; k < sections_; ++k) {
    const double bend = goal_rad_.segment<2>(2 * k).norm();
    if (bend > max_bending_rad_) {
      goal_rad_.segment<2>(2 * k) *= max_bending_rad_ / bend;
      Report(output, Status::kLimitedBending);
    }
  }
  Report(output, reach_.Limit(goal_rad_));
}

void ReferenceMotion::Archive(StateArchive& a) noexcept {
  trajectory_.Archive(a);
  a.Choice(source_, CommandKind::kMode);
  a.Value(waits_);
  a.Vector(goal_rad_, {2 * sections_});
  a.Vector(goal_rate_radps_, {2 * sections_});
}

}  // namespace tendril::control
