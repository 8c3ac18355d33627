#include "tendril/rig/plant_of.h"

#include <fmt/format.h>

#include <stdexcept>

#include "tendril/sim/effects.h"

namespace tendril::rig {

RobotParameters PlantOf(const RobotParameters& controllers, const BusParameters& bus,
                        const std::string& plant_file, const std::vector<std::string>& effects) {
  RobotParameters plant = plant_file.empty() ? controllers : sim::LoadRobot(plant_file);
  for (const NodeParameters& node : bus.nodes) {
    if (plant_file.empty())
      plant.actuation->tendons[static_cast<std::size_t>(node.tendon) - 1].node_id = node.node_id;
  }
  const auto drives = [](const RobotParameters& robot) {
    return robot.actuation ? robot.actuation->drives() : 0;
  };
  if (drives(plant) != drives(controllers) && plant.body.tendons() == controllers.body.tendons()) {
    throw std::runtime_error(
        fmt::format("the controller's robot has {} motors, the plant's {}: give two files of one robot",
                    drives(controllers), drives(plant)));
  }
  if (plant.body.tendons() != controllers.body.tendons()) {
    throw std::runtime_error(
        fmt::format("the controller's robot has {} tendons, the plant's {}: give two files of one robot",
                    controllers.body.tendons(), plant.body.tendons()));
  }
  for (const std::string& effect : effects) plant.effects.push_back(sim::ParseEffect(effect, plant));
  sim::CheckEffects(plant);
  return plant;
}

}  // namespace tendril::rig
