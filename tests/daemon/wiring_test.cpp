// Which drive pulls which tendon, in the units of the bus.
#include "tendril/daemon/wiring.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "emulated_drives.h"

namespace tendril::daemon {
namespace {

using testing::HasSubstr;

// The figures of the A-max 22 / EPOS4 24/1.5 rig, written out by hand.
TEST(Wiring, TheRigsMotorsInUnitsOfTheBus) {
  const std::vector<canopen::DriveSetup> setups = DriveSetups(RigRobot(), RigDaemon().bus);
  ASSERT_EQ(setups.size(), 3U);
  for (const canopen::DriveSetup& s : setups) {
    EXPECT_EQ(s.nominal_current_mA, 360U);
    EXPECT_EQ(s.output_current_limit_mA, 360U);
    EXPECT_EQ(s.torque_constant_uNmpA, 19600U);
    EXPECT_EQ(s.rated_torque_uNm, 7056U);
    EXPECT_EQ(s.rated_torque_uNm, s.nominal_current_mA * s.torque_constant_uNmpA / 1000);
  }
}

TEST(Wiring, TheDaemonsFileDecidesWhichNodePullsWhichTendon) {
  BusParameters bus = RigDaemon().bus;
  bus.nodes = {{7, 3}, {5, 1}, {6, 2}};
  const std::vector<canopen::DriveSetup> setups = DriveSetups(RigRobot(), bus);
  EXPECT_EQ(setups[0].node_id, 5);
  EXPECT_EQ(setups[1].node_id, 6);
  EXPECT_EQ(setups[2].node_id, 7);
}

std::string WhyNot(const RobotParameters& robot, const BusParameters& bus) {
  try {
    DriveSetups(robot, bus);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(Wiring, WhatCannotBeDrivenIsRefused) {
  RobotParameters body = RigRobot();
  body.actuation.reset();
  EXPECT_THAT(WhyNot(body, RigDaemon().bus), HasSubstr("has no actuation"));
  BusParameters bus = RigDaemon().bus;
  bus.nodes.pop_back();
  EXPECT_THAT(WhyNot(RigRobot(), bus), HasSubstr("tendon 3"));
}

TEST(Wiring, ShapeCountsSectionsUnitsAndTendons) {
  const io::RobotShape shape = ShapeOf(RigRobot());
  EXPECT_EQ(shape.sections, 1);
  EXPECT_EQ(shape.units, 4);
  EXPECT_EQ(shape.tendons, 3);
}

}  // namespace
}  // namespace tendril::daemon
