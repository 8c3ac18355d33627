// The drive train in MJCF, which mjcf.cpp puts beside the body. Knows one actuation's tendons.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "xml.h"

namespace tendril::exchange {

/// One motor with what it pulls, as MJCF has it: a slide that the tendon is tied to, in metres of its travel.
struct SpoolSlide {
  int number = 0;            // of the tendon, from 1
  double newton_per_Nm = 0;  // of the motor's torque
  double depth_m = 0;        // below the base
  double reflected_kg = 0, damping_Nspm = 0, friction_N = 0;
  double tendon_stiffness_Npm = 0, tendon_damping_Nspm = 0;
  double slack_length_m = 0;   // of the whole tendon when it begins to pull
  double path_friction_N = 0;  // of the pulleys, on the tendon's way through the robot
  double max_torque_Nm = 0, torque_scale = 1, lag_s = 0, holding_torque_Nm = 0;
};

/// Friction as at `friction_at_N` of base tension; `straight_m` is each tendon's length in the straight
/// robot.
std::vector<SpoolSlide> SpoolSlides(const RobotParameters& robot, double friction_at_N,
                                    const std::vector<double>& straight_m);

void AddSpoolBody(Xml& xml, const SpoolSlide& slide, const Eigen::Vector3d& hole_m);
void AddMotor(Xml& xml, const SpoolSlide& slide);
/// What the motors' friction loses, a sentence each.
std::vector<std::string> LeftOutOfMotors(const std::vector<SpoolSlide>& slides, double friction_at_N);

}  // namespace tendril::exchange
