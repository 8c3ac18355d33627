// Sensors that are slower than the log: between their own readings a logger writes the last one again, or a
// straight line. Knows nothing of robots.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Turns what stands between the own readings of the tip or of a load cell into missing values: as though
/// they were measurements they would hide the sensor's noise. Leaves states at rest as they are. Returns what
/// was found, one sentence for each kind of filling.
std::vector<std::string> KeepOwnReadings(DataSet& set);

}  // namespace tendril::gap
