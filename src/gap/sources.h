// Readers of runs, one function per kind of file. Knows nothing of folders and lists of runs.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "csv.h"
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

/// True where two rows hold the same numbers.
using SameRow = std::function<bool(std::size_t, std::size_t)>;
/// For the rows of a table, counted from row `from`.
SameRow SameNumbers(const Table& table, std::size_t from);

/// Rows with a time that is greater than that of the row before, from the longest part where the clock
/// restarts; warns of dropped rows. Rows that share the stamp of a coarse clock are spread evenly to its next
/// tick in `time_s`. `lines` are the rows' lines in the file.
std::vector<int> RowsInTime(std::vector<double>& time_s, const std::vector<int>& lines, const SameRow& same,
                            Run& run);

/// Notes gaps in the time grid: steps of more than 1.5 times the usual one.
void NoteGaps(Run& run);

}  // namespace tendril::gap
