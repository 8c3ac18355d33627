// How well controllers that believe in different robot files lead one and the same plant, or how well the
// control laws lead plants that differ from what they believe. Knows nothing of how files came about.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tendril::experiment {

struct CompareSetup {
  std::function<std::string(const std::string& name)> config_file;  // finds a file of config/
  std::filesystem::path folder;                                     // for samples, one CSV a trajectory
  std::uint64_t seed = 1;                                           // of the sensors' noise
  const std::atomic<bool>* stop = nullptr;                          // ends it early, by std::runtime_error
};

struct Comparison {
  nlohmann::ordered_json json;
  std::vector<std::string> lines;  // for a terminal
};

/// Names of the laws and of the plants that CompareLaws has.
std::vector<std::string> ComparedLaws();
std::vector<std::string> ComparedPlants();

/// Every law on every plant, these only (none: all). A fault ends its run only.
Comparison CompareLaws(const std::vector<std::string>& laws, const std::vector<std::string>& plants,
                       const std::vector<std::string>& trajectories, const CompareSetup& setup);

/// Robot files, the nominal one first, of controllers on one plant. Throws std::runtime_error on a fault.
Comparison CompareRobots(const std::vector<std::string>& robots, const std::string& plant,
                         const std::vector<std::string>& trajectories, const CompareSetup& setup);

}  // namespace tendril::experiment
