// Where does a robot differ from its simulator, which effect causes it, how far does the gap shrink with the
// effect in the model. Knows nothing of files or pages.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Runs that would tell rivals apart are simulated by whoever has a controller: a family's run on a robot, as
/// a log.
struct ExperimentMenu {
  std::vector<std::string> families;
  /// One run of the family on `plant`, controlled with the nominal file; throws std::runtime_error when it
  /// cannot be run.
  std::function<Run(const std::string& family, const RobotParameters& plant)> simulate;
  /// The plan that `tendril excite --plan` runs.
  std::function<std::string(const std::string& family)> plan;
};

struct DiagnoseOptions {
  double delta_N = 0, delta_m = 0;  // materiality; 0: from the noise floor
  std::uint64_t seed = 1;
  int threads = 0;                   // 0: all cores
  int refits = 8;                    // candidates refitted in full after screening
  std::vector<std::string> without;  // effects taken out of the library
  ExperimentMenu menu;
  /// Called by several threads, several at once.
  std::function<void(const std::string& stage, double fraction)> progress;
};

/// The same result for the same set, options and seed, whatever the number of threads. Throws
/// std::runtime_error when the set cannot be diagnosed at all; anything less is a degradation in the result.
Diagnosis Diagnose(const DataSet& set, const DiagnoseOptions& options);

}  // namespace tendril::gap
