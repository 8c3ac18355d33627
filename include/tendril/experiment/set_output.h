// Where a set of experiments is left. Knows nothing of how its runs are made.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tendril/experiment/experiment_run.h"
#include "tendril/gap/set_folder.h"

namespace tendril::experiment {

/// What the runs of a plan will be called.
std::vector<std::string> FileNames(const Plan& plan);

/// Leaves a set in its folder and returns where. An earlier set gives way to a complete one only; what was
/// `measured` so far then goes beside it. Throws std::runtime_error where nothing is left.
std::filesystem::path WriteSet(const ExperimentSet& set, const gap::SetFolder& folder, bool measured);

}  // namespace tendril::experiment
