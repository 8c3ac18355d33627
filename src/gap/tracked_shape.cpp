// Tracker readings lie between the simulation's rows; both are as reported, with the tracker's delay.
#include "tracked_shape.h"

#include <algorithm>
#include <cmath>

#include "rotation.h"
#include "tendril/model/body.h"
#include "tendril/sim/effects.h"
#include "tracker_frame.h"

namespace tendril::gap {
namespace {

constexpr double kBendingWindow_s = 0.15;  // the tracker corrects the simulated bending more slowly than this
// Free tracker clock: maximum distance from the estimated shift, step, and number of Gauss-Newton passes.
constexpr double kMostLate_s = 0.08, kLateStep_s = 0.01;
constexpr int kClockPasses = 2;

/// (u, v) of the bend that takes z to the frame's z axis; independent of twist.
Eigen::Vector2d BendOf(const Eigen::Matrix3d& R) {
  const Eigen::Vector3d z = R.col(2);
  const double side = std::hypot(z.x(), z.y());
  const double bend = std::atan2(side, z.z());
  return side > 1e-12 ? Eigen::Vector2d(bend / side * z.head<2>()) : Eigen::Vector2d(0, 0);
}

/// Bend of a single arc with its tip at p.
Eigen::Vector2d BendOfTip(const Eigen::Vector3d& p) {
  const double side = std::hypot(p.x(), p.y());
  const double bend = 2 * std::atan2(side, p.z());
  return side > 1e-12 ? Eigen::Vector2d(bend / side * p.head<2>()) : Eigen::Vector2d(0, 0);
}

/// The frame that the robot's effects give the tracker.
TrackerFrame FrameOf(const RobotParameters& robot) {
  const sim::TrackerPlacement placement = sim::PlacementOfTracker(robot);
  TrackerFrame frame;
  frame.turn = placement.R;
  frame.offset_m = placement.offset_m;
  return frame;
}

double DelayOf(const RobotParameters& robot) {
  return robot.actuation && robot.actuation->tracker ? robot.actuation->tracker->delay_s : 0;
}

/// Sections whose bend the tracker shows separately; without bends of its own, one arc.
Eigen::Index Parts(const PreparedRun& run) {
  return run.bending_rad.rows() > 0 ? run.bending_rad.cols() / 2 : 1;
}

/// Tracked less simulated bend, (u, v) of each part, at the tracker's readings.
Eigen::MatrixXd BendResidual(const PreparedRun& run, const RobotParameters& robot,
                             const sim::BodyMotion& motion, double late_s) {
  const bool turned = !run.tip_R.empty(), bent = run.bending_rad.rows() > 0;
  const auto [tracker_R, tracker_p] = FrameOf(robot);
  const int seen = static_cast<int>(run.tracker_s.size());
  Eigen::MatrixXd residual(seen, 2 * Parts(run));
  for (int k = 0; k < seen; ++k) {
    const int at = std::clamp(static_cast<int>(std::lround((run.tracker_s[k] - late_s) / run.signals.step_s)),
                              0, run.samples() - 1);
    const Eigen::Vector3d tip = motion.tip_m.row(at).transpose();
    if (bent) {
      residual.row(k) = run.bending_rad.row(k) - motion.bending_rad.row(at);
    } else if (turned) {
      const Eigen::Matrix3d simulated = Rotation(motion.tip_rotation.row(at).transpose());
      residual.row(k) =
          BendOf(tracker_R.transpose() * run.tip_R[k]) - BendOf(tracker_R.transpose() * simulated);
    } else {
      const Eigen::Vector3d measured_tip = run.tip_m.row(k).transpose();
      residual.row(k) = BendOfTip(tracker_R.transpose() * (measured_tip - tracker_p)) -
                        BendOfTip(tracker_R.transpose() * (tip - tracker_p));
    }
  }
  return residual;
}

/// Mean of the rows within half of kBendingWindow_s.
Eigen::MatrixXd Smoothed(const Eigen::MatrixXd& rows, const Eigen::VectorXd& time_s) {
  const int count = static_cast<int>(rows.rows());
  Eigen::MatrixXd smooth(count, rows.cols());
  int low = 0, high = 0;
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(rows.cols());
  for (int k = 0; k < count; ++k) {
    while (high < count && time_s[high] <= time_s[k] + 0.5 * kBendingWindow_s) sum += rows.row(high++);
    while (time_s[low] < time_s[k] - 0.5 * kBendingWindow_s) sum -= rows.row(low++);
    smooth.row(k) = sum / (high - low);
  }
  return smooth;
}

}  // namespace

bool HasTrackerEffect(const RobotParameters& robot) {
  const sim::TrackerPlacement placement = sim::PlacementOfTracker(robot);
  return !placement.R.isIdentity(0) || !placement.offset_m.isZero(0) ||
         DelayOf(sim::FoldEffects(robot)) != DelayOf(robot);
}

TipResidual ResidualOfTip(const sim::BodyMotion& motion, const PreparedRun& run, double late_s) {
  const int samples = run.samples(), rows = static_cast<int>(motion.tip_m.rows());
  const double step_s = run.signals.step_s;
  TipResidual out;
  const Eigen::Index bends = motion.bending_rad.cols();
  out.tip = Eigen::MatrixXd::Constant(samples, 6 + bends, NAN);
  double slope = 0, curvature = 0;
  for (int k = 0; k < run.tracker_s.size(); ++k) {
    const double row = std::clamp((run.tracker_s[k] - late_s) / step_s, 0.0, rows - 1.0);
    const int r0 = std::min(static_cast<int>(row), rows - 1), r1 = std::min(r0 + 1, rows - 1);
    const double share = row - r0;
    const int at = std::clamp(static_cast<int>(std::lround(run.tracker_s[k] / step_s)), 0, samples - 1);
    if (run.bending_rad.rows() > 0) {
      out.tip.row(at).tail(bends) = run.bending_rad.row(k) - (1 - share) * motion.bending_rad.row(r0) -
                                    share * motion.bending_rad.row(r1);
    }
    const Eigen::RowVector3d moved_m = motion.tip_m.row(r1) - motion.tip_m.row(r0);
    const bool placed = run.tip_m.rows() > 0;
    const Eigen::RowVector3d off_m =
        placed ? Eigen::RowVector3d(run.tip_m.row(k) - motion.tip_m.row(r0) - share * moved_m)
               : Eigen::RowVector3d::Constant(NAN);
    out.tip.row(at).head<3>() = off_m;
    if (placed && run.driven[static_cast<std::size_t>(at)]) {
      out.square_m2 += off_m.squaredNorm();
      slope += off_m.dot(moved_m) / step_s;
      curvature += moved_m.squaredNorm() / (step_s * step_s);
    }
    if (run.tip_R.empty()) continue;
    const Eigen::Vector3d turn =
        motion.tip_rotation.row(r0) + share * (motion.tip_rotation.row(r1) - motion.tip_rotation.row(r0));
    out.tip.row(at).segment<3>(3) = RotationVector(run.tip_R[k] * Rotation(turn).transpose());
  }
  if (curvature > 0) out.later_s = -slope / curvature;
  return out;
}

double LateByTip(const sim::BodyMotion& motion, const PreparedRun& run) {
  if (!run.tracked() || run.tip_m.rows() == 0 || run.signals.at_rest) return 0;
  double late_s = 0, least_m2 = ResidualOfTip(motion, run, 0).square_m2;
  for (double tried_s = -kMostLate_s; tried_s <= kMostLate_s; tried_s += kLateStep_s) {
    const double square_m2 = ResidualOfTip(motion, run, tried_s).square_m2;
    if (square_m2 < least_m2) least_m2 = square_m2, late_s = tried_s;
  }
  for (int pass = 0; pass < kClockPasses; ++pass)
    late_s += std::clamp(ResidualOfTip(motion, run, late_s).later_s, -kLateStep_s, kLateStep_s);
  return late_s;
}

Eigen::MatrixXd MeasuredShortening(const PreparedRun& run, const RobotParameters& robot,
                                   const sim::BodyMotion& motion, double late_s) {
  const bool turned = !run.tip_R.empty(), bent = run.bending_rad.rows() > 0;
  if (!run.tracked() || (!turned && !bent && robot.body.sections.size() > 1)) return motion.shortening_m;
  const RobotParameters folded = sim::FoldEffects(robot);
  const double delay_s =
      folded.actuation->tracker && !run.signals.at_rest ? folded.actuation->tracker->delay_s : 0;
  const Eigen::Index parts = Parts(run);
  const Eigen::MatrixXd smooth = Smoothed(BendResidual(run, robot, motion, late_s), run.tracker_s);
  const int samples = run.samples(), seen = static_cast<int>(run.tracker_s.size());
  const model::Body body(folded.body);
  const int units = body.units();
  Eigen::MatrixXd shortening(samples, body.tendons());
  Eigen::VectorXd q(body.dof()), d(body.tendons());
  int at = 0;
  for (int i = 0; i < samples; ++i) {
    const double seen_at = i * run.signals.step_s + delay_s + late_s;
    while (at + 2 < seen && run.tracker_s[at + 1] < seen_at) ++at;
    const double span = run.tracker_s[at + 1] - run.tracker_s[at];
    const double share = span > 0 ? std::clamp((seen_at - run.tracker_s[at]) / span, 0.0, 1.0) : 0;
    const Eigen::RowVectorXd delta = smooth.row(at) + share * (smooth.row(at + 1) - smooth.row(at));
    q = motion.q.row(i).transpose();
    for (int part = 0; part < parts; ++part) {
      const int first = bent ? body.first_unit(part) : 0, end = bent ? body.end_unit(part) : units;
      for (int u = first; u < end; ++u)
        q.segment<2>(body.coordinate(u)) += delta.segment<2>(2 * part).transpose() / (end - first);
    }
    body.TendonShortening(q, d);
    shortening.row(i) = d.transpose();
  }
  return shortening;
}

}  // namespace tendril::gap
