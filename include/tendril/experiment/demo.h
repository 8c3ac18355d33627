// One motion of the demo: controller, bus, drives and plant in one process follow it in simulated time;
// leaves a log, samples and a summary. Knows nothing of the program that shows it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tendril/core/daemon.h"

namespace tendril::experiment {

struct DemoRun {
  std::string motion;                  // of motion::MakeMotion
  std::string robot_file, plant_file;  // the controller's and the plant's
  DaemonParameters daemon;
  bool capstan_compensation = true;
  std::uint64_t seed = 1;  // of the sensors' noise
  std::filesystem::path folder;
};

/// How far a run is.
struct DemoProgress {
  double share = 0, simulated_s = 0, wall_s = 0, tip_error_m = 0;
  bool last = false;
};

/// Writes run.lcmlog, samples.csv and summary.json into the folder, and removes what an earlier run left
/// there; returns the summary. `stopped_by` is asked every cycle: not empty, it names what ends the run.
/// Throws std::runtime_error when the robot faults, when it is stopped, or when something cannot be written.
nlohmann::ordered_json RunDemo(const DemoRun& demo, const std::function<void(const DemoProgress&)>& progress,
                               const std::function<std::string()>& stopped_by);

/// Summaries side by side, for a terminal; and what limited the robot or went wrong.
std::string DemoTable(const std::vector<nlohmann::ordered_json>& summaries);

}  // namespace tendril::experiment
