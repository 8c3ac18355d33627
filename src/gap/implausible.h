// Samples that cannot be measurements of this robot. Knows nothing of models.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Turns into missing values: rare values far beyond what the robot can reach, whole columns of tension,
/// torque or tip that lie there (another unit), stretches in which a cell or the tracker keeps one value to
/// the last bit while the motor turns, and what is cut off at the end of a sensor's range. Returns what was
/// taken out, one sentence each.
std::vector<std::string> TakeOutImplausible(DataSet& set);

}  // namespace tendril::gap
