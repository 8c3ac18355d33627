// Are the data fit for a diagnosis: what is wrong with runs as they were recorded, before any model is asked.
// Knows nothing of effects.
#pragma once

#include <vector>

#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Findings of the set (run is empty) and of each run, in the order of the runs. A text says what was found,
/// what it means for the diagnosis and, but for information, the remedy, separated by "; ". Looks at
/// sampling, missing, constant, clipped and coarse signals, units by magnitude, order and sign of tendons,
/// the robot file, the beginning at rest, the excitation, the tracker's clock, and repetitions. Never throws
/// on a loaded set, however odd.
std::vector<HealthFinding> CheckHealth(const DataSet& set);

}  // namespace tendril::gap
