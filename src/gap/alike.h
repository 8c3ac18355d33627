// Runs of one set made comparable before they are prepared. Knows nothing of models.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Takes out runs whose time is in another unit than the others'; a line for each.
std::vector<std::string> TakeOutOtherTime(DataSet& set);

/// Gives every run the columns of drives and cells that any of them has, without values, so that what one run
/// lacks leaves the others theirs. A run declared without load cell has none, whatever its columns hold.
void FillMissing(DataSet& set);

}  // namespace tendril::gap
