// A robot as other simulators read it: MJCF of MuJoCo, and URDF. Knows the model, no files.
//
// A unit is one arc, cut into three straight pieces by hinges near 1/6 and 5/6 of its length, where the chord
// is the arc's at the section's limit and up to the bend's fourth power elsewhere: u about y, v about -x, v,
// u, the second of each equal to the first. A rotation in this order does not twist the disk about its axis,
// as an arc does not. A hinge turns by half of the unit's bend.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::exchange {

struct Exported {
  std::string text;                   // the whole file; a comment at its top lists the same
  std::vector<std::string> left_out;  // what the format cannot carry of this robot, a sentence each
};

enum class Actuators {
  kTensions,  // one control a tendon, its tension at the base [N]
  kMotors,    // one control a tendon, its motor's torque [N·m]; gear, spool, elastic tendon and friction
};

/// Of the words "tensions" and "motors"; throws std::invalid_argument for others.
Actuators ActuatorsOf(const std::string& word);

struct MjcfOptions {
  std::optional<Actuators> actuators;  // motors where the robot has them
  std::optional<double>
      friction_at_N;  // base tension whose losses the constant friction has; limits.min_tension_N
  std::optional<double> timestep_s;  // as the highest frequency allows
};

/// Statics and frequencies as Body's. Throws std::invalid_argument for a body that is none (see Body), for
/// motors that the robot does not have, for a friction_at_N beyond 0 to 1e4 and a timestep_s beyond 1e-7 to
/// 0.1.
Exported Mjcf(const RobotParameters& robot, const MjcfOptions& options = {});

/// The kinematic chain with inertias: two joints a unit, and two that mimic them. Throws as Body does.
Exported Urdf(const RobotParameters& robot);

/// Angles of the hinges u and v of each unit [rad], 2N, for its bends q = u1, v1, ... [rad]: the values of
/// the joints unit1_u, unit1_v, unit2_u, ... of both formats. Exact for bends of less than pi.
Eigen::VectorXd HingeAngles(model::ConstVectorRef q);

}  // namespace tendril::exchange
