// Imports tables of other programs as measured runs, through a column map. Knows units and frames, nothing of
// what a diagnosis does with them.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Reads the tables through the map (its keys: config/import/every_key_map.yaml): columns become canonical
/// channels in SI units and tendon order, tip poses are moved to the base frame, and tables are split into
/// runs whose times begin at 0. Throws std::runtime_error on an invalid map (file:line: key: what; accepted;
/// remedy). A table that cannot be read and a run of fewer than two rows are left out with a note; throws
/// std::runtime_error when no run is left.
DataSet ImportTables(const std::string& map_path, const std::vector<std::string>& tables,
                     const RobotParameters& robot);

}  // namespace tendril::gap
