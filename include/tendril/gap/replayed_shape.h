// The shape that a robot would have had in a measured run, for who draws it beside the measured one.
// Simulates as the diagnosis does; knows nothing of what is drawn.
#pragma once

#include <Eigen/Core>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// T x 2N: the bends of the units [rad] at these times of the run [s, as Run::time_s], of the body driven by
/// the load cells' readings or, without cells, by the motors' angles; the robot's effects are included. NaN
/// outside the run. Throws std::runtime_error where neither is recorded, the run is too short, or the motion
/// cannot be integrated.
Eigen::MatrixXd ReplayedShape(const RobotParameters& robot, const Run& run, const Eigen::VectorXd& times_s);

}  // namespace tendril::gap
