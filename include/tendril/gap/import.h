// Anybody's tables as measured runs, through a column map. Knows units and frames, nothing of what a
// diagnosis does with them.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Reads the tables through the map (keys in README): columns to canonical channels in SI units, in tendon
/// order, the tracker's frame to the base's, a table to runs. Times begin at 0 in each run. What is wrong
/// with the map throws std::runtime_error: file:line: key: what; accepted; remedy. A table that cannot be
/// read, or a run of less than two rows, is left out with a note; std::runtime_error when no run is left.
DataSet ImportTables(const std::string& map_path, const std::vector<std::string>& tables,
                     const RobotParameters& robot);

}  // namespace tendril::gap
