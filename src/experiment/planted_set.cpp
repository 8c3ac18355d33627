#include "tendril/experiment/planted_set.h"

#include <fmt/format.h>

#include <stdexcept>

#include "tendril/core/load_cell_place.h"
#include "tendril/core/usage_error.h"
#include "tendril/gap/data_set.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {

LoadCellPlace LoadCellPlaceNamed(const std::string& name) {
  if (const auto place = FindLoadCellPlace(name)) return *place;
  throw UsageError(fmt::format("'{}' is no place of a load cell; accepted: {}", name, kLoadCellPlaceWords));
}

RobotParameters WithSensors(RobotParameters robot, const std::string& from,
                            std::optional<LoadCellPlace> load_cell, bool tracker) {
  if (!robot.actuation) {
    throw std::runtime_error(
        from + " has no actuation (motors, drives, tendons); use a rig file such as rig_90mm.yaml");
  }
  gap::RequireAMotorForEachTendon(robot);
  if (load_cell) {
    for (auto& tendon : robot.actuation->tendons) {
      if (*load_cell != LoadCellPlace::kNone && !(tendon.load_cell.gain_VpN > 0))
        throw UsageError(from + " has no load cell whose place could be changed");
      tendon.load_cell.place = *load_cell;
    }
  }
  if (!tracker) robot.actuation->tracker.reset();
  return robot;
}

void RepeatEach(Plan& plan, int repeats) {
  for (PlannedRun& run : plan.runs) run.repeats = repeats;
}

PlantedEffects Plant(const std::vector<std::string>& effects, const RobotParameters& nominal,
                     RobotParameters& plant) {
  PlantedEffects planted;
  for (const std::string& text : effects) {
    planted.requested.push_back(ParseRequestedSize(text, nominal));
    const auto& requested = planted.requested.back();
    plant.effects.push_back(requested ? requested->setting : sim::ParseEffect(text, nominal));
  }
  sim::CheckEffects(plant);
  return planted;
}

void SetAmounts(PlantedEffects& effects, const Plan& plan, ExperimentOptions& options,
                const std::atomic<bool>* stop,
                const std::function<void(const std::string& stage, double share)>& progress) {
  effects.sized = AmountsFor(effects.requested, plan, options, stop, progress);
  auto& planted = options.plant_robot.effects;
  const std::size_t first = planted.size() - effects.sized.size();
  for (std::size_t i = 0; i < effects.sized.size(); ++i) {
    if (effects.sized[i]) planted[first + i] = effects.sized[i]->setting;
  }
}

}  // namespace tendril::experiment
