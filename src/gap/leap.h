// A motor that leaves its way for a few rows and comes back: a motion that a motor can make, one that only a
// stronger motor than the file's can, or a mishap of the encoder. Knows nothing of models.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Rows of a motor's position that stand out between the readings beside them.
struct MotorLeap {
  enum class Is { kMotion, kBeyondFile, kMishap };
  Is is = Is::kMishap;
  std::vector<Eigen::Index> rows;
  Eigen::Index farthest = 0;  // of the rows
  double off_rad = 0;         // there, from the straight line between the readings beside them
  /// Torque at the shaft without which the rotor cannot be there, and what the file's drive gives.
  double needed_Nm = 0, file_Nm = 0;
  double tension_N = 0;  // by which the tendon's went with it; 0: not seen to
};

/// What `rows` (increasing) of tendon j's motor position are. A motion within the larger of the file's torque
/// and the recorded one is possible; beyond, it is one where the load cell shows at least half of what the
/// tendon's spring makes of it. Without actuation in the file all are mishaps.
std::vector<MotorLeap> MotorLeaps(const Run& run, Eigen::Index tendon, const RobotParameters& robot,
                                  const std::vector<Eigen::Index>& rows);

/// Of `rows` (increasing) in which a tension stands out, those that its motor's motion does not explain at
/// least half of.
std::vector<Eigen::Index> TensionsAlone(const Run& run, Eigen::Index tendon, const RobotParameters& robot,
                                        const std::vector<Eigen::Index>& rows);

}  // namespace tendril::gap
