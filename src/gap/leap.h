// A motor that leaves its path for a few rows and comes back: a motion that the motor can make, one that
// needs a stronger motor than the file's, or an encoder error. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Rows of a motor's position that stand out between the readings beside them.
struct MotorLeap {
  /// kExceedsFile: a motion for which the motor of the file is too weak.
  enum class Kind { kMotion, kExceedsFile, kEncoderError };
  Kind kind = Kind::kEncoderError;
  std::vector<Eigen::Index> rows;
  Eigen::Index farthest = 0;  // row of the largest deviation
  double off_rad = 0;         // that deviation from the straight line between the readings beside them
  /// Torque at the shaft needed to bring the rotor there, and the torque of the file's drive.
  double needed_Nm = 0, file_Nm = 0;
  double tension_N = 0;  // simultaneous change of the tendon's tension; 0: none seen
};

/// Classifies `rows` (increasing) of tendon j's motor position. A motion within the larger of the file's
/// torque and the recorded torque is possible. Beyond that it is a motion where the load cell shows at least
/// half of the change that the tendon's spring predicts, otherwise an encoder error. Without actuation in the
/// file all are encoder errors.
std::vector<MotorLeap> MotorLeaps(const Run& run, Eigen::Index tendon, const RobotParameters& robot,
                                  const std::vector<Eigen::Index>& rows);

/// Those of `rows` (increasing) with an outlying tension of which the motor's motion explains less than half.
std::vector<Eigen::Index> TensionsAlone(const Run& run, Eigen::Index tendon, const RobotParameters& robot,
                                        const std::vector<Eigen::Index>& rows);

}  // namespace tendril::gap
