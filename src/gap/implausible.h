// Samples that cannot be measurements of this robot. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// A sensor that keeps one value for so long while the robot moves is frozen.
inline constexpr double kFrozen_s = 0.3;

/// Motor angle that bends every section from one limit to the other; 0 where the robot file does not give it.
double MostMotorWay_rad(const RobotParameters& robot);

/// Isolated rows of one motor's position, in a motion, that it cannot have reached between its neighbours.
std::vector<Eigen::Index> LonePositions(const Eigen::Ref<const Eigen::VectorXd>& position_rad,
                                        const RobotParameters& robot);

/// What was masked, and what contradicts the robot.
struct Masked {
  std::vector<std::string> lines;  // one sentence each
  /// Kinds of signal of which at least half of the columns lie beyond the robot's range: "the tension reaches
  /// 5550 N, and this robot 15 N at most".
  std::vector<std::string> contradictions;
};

/// Turns into missing values: rare values far beyond the robot's reach; whole columns of tension, torque or
/// tip that lie there (another unit); isolated motor positions far from their neighbours; stretches in which
/// a cell or the tracker keeps one value to the last bit while the motor turns; values clipped at the end of
/// a sensor's range; and what MaskMarkerErrors finds.
Masked MaskImplausible(DataSet& set);

}  // namespace tendril::gap
