// Where the disks of a robot are while its motors hold their positions, and how that depends on its numbers.
// Statics, with the friction between spools and base by the direction in which each tendon slid last: inertia
// and what else depends on the way are left to the discrepancy. Knows nothing of priors.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <map>
#include <vector>

#include "states.h"
#include "tendril/core/robot.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// A robot, and what its file does not hold.
struct PostureRobot {
  RobotParameters robot;
  Eigen::VectorXd zero_m;    // M: pull of each tendon while its motor reads 0
  double slack_width_m = 0;  // pull over which a tendon goes slack
  // The body in a state is that of the motors `motor_lag_s` + `clock_drift` t before, t after the run's first
  // reading: a tracker's clock may gain on theirs.
  double motor_lag_s = 0, clock_drift = 0;
  // The tracker sees a point p of the base frame at R(turn) p + shift.
  Eigen::Vector3d turn_rad = Eigen::Vector3d::Zero(), shift_m = Eigen::Vector3d::Zero();
  /// By disk: a sensor of its orientation is turned by this in the disk's axes; not turned where there is
  /// none.
  std::map<int, Eigen::Vector3d> mount_rad{};

  /// A robot of a file: `effects` are worked into its numbers, and offsets of encoders and tracker into the
  /// others. Laws that statics cannot show are passed over.
  static PostureRobot Of(const RobotParameters& robot);
};

/// An effect that is the same as another zero of a motor (sim::Effect::zero), with its parameter in rad or m.
void MoveZero(PostureRobot& robot, const sim::Effect& effect, sim::Target tendon, double value);

/// At the states of all runs, one below the other.
struct Predicted {
  Eigen::MatrixXd channels_m;           // S x C
  std::vector<Eigen::MatrixXd> slopes;  // by number: d channels / d number
  int unsolved = 0;                     // states without an equilibrium: those of the nearest before them
};

using RobotAt = std::function<PostureRobot(const Eigen::VectorXd& x)>;

/// `slopes`: how many of the numbers x, from the first, slopes are wanted of. Deterministic for any number of
/// threads. Throws std::invalid_argument for a robot that cannot be.
Predicted Predict(const RobotAt& robot_at, const Eigen::VectorXd& x, int slopes, const Postures& postures,
                  int threads);

}  // namespace tendril::gap
