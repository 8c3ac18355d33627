// Sensors that are slower than the log: between their readings a logger repeats the last one or interpolates.
// Knows nothing of robots.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Turns repeated and interpolated values between readings of the tip or a load cell into missing values,
/// since they would hide the sensor's noise if taken for measurements. States at rest stay unchanged. Returns
/// one sentence for each kind of filling found.
std::vector<std::string> KeepOwnReadings(DataSet& set);

}  // namespace tendril::gap
