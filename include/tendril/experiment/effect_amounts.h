// The effects of a simulated data set that are given by their size: their amounts, found by running the same
// experiments without them. Knows nothing of how they are diagnosed.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tendril/experiment/experiment_run.h"
#include "tendril/experiment/sized_effect.h"

namespace tendril::experiment {

/// For each requested size the amount that has it, each effect by itself on the robot of
/// options.controller_robot; empty where none is requested, and nothing is run where none is at all. A floor
/// is what noise makes it: sensors have theirs whether or not the data get any. `progress` receives a stage
/// and its completed share, from several threads, one at a time. Throws std::runtime_error when the runs
/// without effects are not complete, or after `stop`, which is not null.
std::vector<std::optional<SizedEffect>> AmountsFor(
    const std::vector<std::optional<RequestedSize>>& requested, const Plan& plan, ExperimentOptions options,
    const std::atomic<bool>* stop,
    const std::function<void(const std::string& stage, double share)>& progress);

/// "backlash where=tendon:2 rad=0.05: 3 sigma in tension", and why it is not the requested size.
std::string SizeLine(const SizedEffect& effect);

/// What is planted in a simulated data set, as JSON: robot file, seed and every effect with its parameters,
/// and its size where one was requested. `effects` ends with those of `requested`, in their order.
std::string TruthJson(const std::string& robot_file, std::uint64_t seed,
                      const std::vector<EffectSetting>& effects,
                      const std::vector<std::optional<RequestedSize>>& requested,
                      const std::vector<std::optional<SizedEffect>>& sized);

}  // namespace tendril::experiment
