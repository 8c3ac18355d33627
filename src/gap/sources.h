// Readers of runs, one function per kind of file. Knows nothing of folders and lists of runs.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "same_robot.h"
#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// A canonical CSV. Throws std::runtime_error, one line naming file, line and column.
Run ReadRunTable(const std::filesystem::path& file, const RobotParameters& robot);

/// True for the first bytes of an LCM event log, or the extension .lcmlog.
bool IsLcmLog(const std::filesystem::path& file);
/// An LCM log: one run per stretch between arming and disarming. Throws std::runtime_error when it holds
/// none, OtherRobotError when it was recorded with another robot. `notes`: on the robot that it was recorded
/// with.
std::vector<Run> ReadRunLog(const std::filesystem::path& file, const RobotOfSet& of_set,
                            std::vector<std::string>& notes);
/// The robot file embedded in a log; empty when it has none. Throws std::runtime_error when it cannot be
/// read.
std::string RobotYamlOfLog(const std::filesystem::path& file);

/// Where the load cells of a robot are: as on its first tendon that has one, else none.
LoadCellPlace CellPlace(const RobotParameters& robot);

/// File name without the extension .csv or .lcmlog.
std::string RunName(const std::filesystem::path& file);

}  // namespace tendril::gap
