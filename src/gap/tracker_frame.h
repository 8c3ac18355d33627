// The tracker's frame relative to the robot's base, and its fit where nobody measured it. Knows no effects.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "prepare.h"
#include "tendril/core/robot.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {

/// Pose of the tracker's frame relative to the robot's base: it reports p = turn p_base + offset_m.
struct TrackerFrame {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();

  /// Standard deviations of its error where it is fitted to the nominal robot; the offset's is a share of the
  /// length.
  static constexpr double kTurn_rad = 0.1;
  static double Shift_m(const RobotParameters& robot) { return 2.0 / 9 * robot.body.length_m(); }

  /// Transforms the tracker's readings of a run into the base's frame.
  void ToBase(PreparedRun& run) const;
  /// The sentence for a frame that was fitted to this robot.
  std::string Text(const RobotParameters& robot) const;
};

/// The rigid motion that maps the robot's tips in `motions` onto the measured ones, by least squares with
/// reduced weight for large distances, since the error of a differing robot is not uniform. Throws
/// std::runtime_error where the tips lie on a line.
TrackerFrame FitTrackerFrame(const std::vector<PreparedRun>& runs,
                             const std::vector<sim::BodyMotion>& motions);

}  // namespace tendril::gap
