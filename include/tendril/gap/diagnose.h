// Finds where a robot differs from its simulator, which effect causes it, and how far the gap shrinks once
// the effect is in the model. Knows nothing of files or pages.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Candidate experiments that may tell rival causes apart. The caller, who has a controller, provides their
/// simulation.
struct ExperimentMenu {
  std::vector<std::string> families;
  /// Simulates one run of the family on `plant`, controlled with the nominal file, and returns its log;
  /// throws std::runtime_error when it cannot be run.
  std::function<Run(const std::string& family, const RobotParameters& plant)> simulate;
  /// The plan file that `tendril excite --plan` runs.
  std::function<std::string(const std::string& family)> plan;
};

struct DiagnoseOptions {
  double delta_N = 0, delta_m = 0;  // materiality; 0: derived from the noise floor
  std::uint64_t seed = 1;
  int threads = 0;                   // 0: all cores
  int refits = 8;                    // candidates refitted in full after screening
  std::vector<std::string> without;  // effects taken out of the library
  ExperimentMenu menu;
  /// Called from several threads concurrently.
  std::function<void(const std::string& stage, double fraction)> progress;
};

/// The result depends only on set, options and seed, not on the number of threads. Throws std::runtime_error
/// when the set cannot be diagnosed at all; lesser shortcomings are listed as degradations in the result.
Diagnosis Diagnose(const DataSet& set, const DiagnoseOptions& options);

}  // namespace tendril::gap
