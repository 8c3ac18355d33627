// The robot behind a simulation's drives: wired as the daemon expects, unless it is another robot's file.
#include "tendril/rig/plant_of.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tendril/config/config.h"

namespace tendril::rig {
namespace {

constexpr const char* kRig = TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml";

TEST(PlantOf, WithoutAFileItIsTheControllersRobotAtTheNodesOfTheBus) {
  const RobotParameters robot = config::LoadRobot(kRig);
  BusParameters bus;
  for (int tendon = 1; tendon <= 3; ++tendon) bus.nodes.push_back({.node_id = 40 + tendon, .tendon = tendon});
  const RobotParameters plant = PlantOf(robot, bus, "", {"tip_payload mass_kg=0.002"});
  for (std::size_t j = 0; j < 3; ++j)
    EXPECT_EQ(plant.actuation->tendons[j].node_id, 41 + static_cast<int>(j));
  ASSERT_EQ(plant.effects.size(), robot.effects.size() + 1);
  EXPECT_EQ(plant.effects.back().name, "tip_payload");
  // A file of its own says how it is wired.
  EXPECT_EQ(PlantOf(robot, bus, kRig, {}).actuation->tendons[0].node_id, robot.actuation->tendons[0].node_id);
}

TEST(PlantOf, AnotherNumberOfTendonsAndAnUnknownEffectAreRefused) {
  const RobotParameters robot = config::LoadRobot(kRig);
  EXPECT_THROW(PlantOf(robot, {}, TENDRIL_SOURCE_DIR "/config/robots/four_tendon_90mm.yaml", {}),
               std::runtime_error);
  EXPECT_THROW(PlantOf(robot, {}, "", {"gremlins"}), std::invalid_argument);
}

}  // namespace
}  // namespace tendril::rig
