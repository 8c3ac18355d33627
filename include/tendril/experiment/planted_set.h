// What a simulated data set has that its nominal robot file has not: sensors left out, effects planted by
// their parameters or their size. Knows nothing of files and of how the set is diagnosed.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tendril/experiment/effect_amounts.h"
#include "tendril/experiment/experiment_run.h"

namespace tendril::experiment {

/// By its word (core/load_cell_place.h); throws UsageError naming them all.
LoadCellPlace LoadCellPlaceNamed(const std::string& name);

/// The robot with its load cells at another place (empty: as they are), and with its tracker or without.
/// `from`: where the robot is from, for errors. Throws std::runtime_error for a robot without actuation,
/// UsageError where there is no load cell.
RobotParameters WithSensors(RobotParameters robot, const std::string& from,
                            std::optional<LoadCellPlace> load_cell, bool tracker);

/// Every run repeated so often, instead of as the plan says.
void RepeatEach(Plan& plan, int repeats);

/// The effects that a plant gets beside those of its nominal robot, as they were requested and, once found,
/// with the amounts of those that were given by their size.
struct PlantedEffects {
  std::vector<std::optional<RequestedSize>> requested;
  std::vector<std::optional<SizedEffect>> sized;
};

/// Adds the effects, each as a text (sim::ParseEffect, ParseRequestedSize), to the plant. Throws
/// std::invalid_argument.
PlantedEffects Plant(const std::vector<std::string>& effects, const RobotParameters& nominal,
                     RobotParameters& plant);

/// Finds the amounts of those given by their size (AmountsFor) and sets them in options.plant_robot.
void SetAmounts(PlantedEffects& effects, const Plan& plan, ExperimentOptions& options,
                const std::atomic<bool>* stop,
                const std::function<void(const std::string& stage, double share)>& progress);

}  // namespace tendril::experiment
