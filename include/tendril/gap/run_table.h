// One run as a table with the canonical columns, for other programs. Knows nothing of folders.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Column names (RunColumns) and values, S rows; NaN where there is no new value.
struct RunTable {
  std::vector<std::string> names;
  Eigen::MatrixXd values;
};

/// Throws std::runtime_error when a channel has another number of rows than the time.
RunTable TableOf(const Run& run);

}  // namespace tendril::gap
