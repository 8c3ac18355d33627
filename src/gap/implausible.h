// Samples that cannot be measurements of this robot. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Angle of a motor that bends every section from one limit to the other; 0 where the robot file does not
/// say.
double MostMotorWay_rad(const RobotParameters& robot);

/// Rows of single motor positions, of one motor in motion, where it cannot have been between the rows beside
/// them.
std::vector<Eigen::Index> LonePositions(const Eigen::Ref<const Eigen::VectorXd>& position_rad,
                                        const RobotParameters& robot);

/// Turns into missing values: rare values far beyond what the robot can reach, whole columns of tension,
/// torque or tip that lie there (another unit), single motor positions far from those beside them, stretches
/// in which a cell or the tracker keeps one value to the last bit while the motor turns, and what is cut off
/// at the end of a sensor's range. Returns what was taken out, one sentence each.
std::vector<std::string> TakeOutImplausible(DataSet& set);

}  // namespace tendril::gap
