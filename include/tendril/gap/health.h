// Checks whether recorded runs are fit for a diagnosis, before any model is used. Knows nothing of effects.
#pragma once

#include <vector>

#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Findings about the set (run is empty) and about each run, in the order of the runs. A text says what was
/// found, what it means for the diagnosis and, except for information, the remedy, separated by "; ". Checks
/// sampling; missing, constant, clipped and coarse signals; units by magnitude; order and sign of tendons;
/// the robot file; the initial rest; the excitation; the tracker's clock; and repetitions. Never throws on a
/// loaded set.
std::vector<HealthFinding> CheckHealth(const DataSet& set);

}  // namespace tendril::gap
