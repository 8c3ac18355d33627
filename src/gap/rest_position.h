// The zero of motors that count from where friction had left the robot. Simulates nothing.
#pragma once

#include <Eigen/Core>

#include "prepare.h"
#include "tendril/core/robot.h"

namespace tendril::gap {

/// Rest position of motors that count from it, as far as cells and counts (S x M) determine it.
void FindRest(const RobotParameters& robot, const Eigen::MatrixXd& reading, PreparedRun& out);

}  // namespace tendril::gap
