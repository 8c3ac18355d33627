// What a diagnosis found, as a robot file takes it. Knows nothing of how such a file is changed.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// The accepted causes, each value without digits that its interval does not know: rounded by at most a
/// hundredth of the interval, and never out of it.
std::vector<EffectSetting> FoundEffects(const Diagnosis& diagnosis);

/// The robot of the file with the numbers that the diagnosis learned; without such, the file's.
RobotParameters WithLearnedNumbers(const RobotParameters& file, const Diagnosis& diagnosis);

/// Where they come from, as lines for comments: the program and `report`'s name, verdict and robot, a line
/// for each cause with its intervals, what they close, and each log's sha256. No line has control characters.
std::vector<std::string> Provenance(const Diagnosis& diagnosis, const std::string& report);

}  // namespace tendril::gap
