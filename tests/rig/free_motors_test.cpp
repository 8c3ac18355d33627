// Motors without a robot behind drives beyond those of a robot file. The expected motion is the closed form
// of a rotor under constant torque with Coulomb and viscous friction.
#include "tendril/rig/free_motors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "emulator/raw_master.h"

namespace tendril::rig {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TendonDriveParameters Like() {
  TendonDriveParameters like;
  like.motor.torque_constant_NmpA = 19.6e-3;
  like.motor.nominal_current_A = 0.36;
  like.motor.rotor_inertia_kgm2 = 1e-6;
  like.motor.coulomb_friction_Nm = 2e-4;
  like.motor.viscous_friction_Nms = 1e-6;
  like.drive.encoder_counts_per_turn = 4096;
  return like;
}

std::vector<int> Nodes(int first, int last) {
  std::vector<int> nodes;
  for (int node = first; node <= last; ++node) nodes.push_back(node);
  return nodes;
}

TEST(NodeList, IsNodesAndRanges) {
  EXPECT_THAT(rig::ParseNodeList("7", {}), ElementsAre(7));
  EXPECT_THAT(rig::ParseNodeList("4-6,40,1-1", {}), ElementsAre(4, 5, 6, 40, 1));
  EXPECT_EQ(rig::ParseNodeList("1-127", {}).size(), 127u);
}

TEST(NodeList, SaysWhatDoesNotFit) {
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      rig::ParseNodeList(text, {1, 2, 3});
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "(accepted)";
  };
  EXPECT_THAT(refusal("four"), HasSubstr("'four' in 'four' is not a node id; accepted: node ids and ranges"));
  EXPECT_THAT(refusal("4-"), HasSubstr("'' in '4-' is not a node id"));
  EXPECT_THAT(refusal("4,,5"), HasSubstr("'' in '4,,5'"));
  EXPECT_THAT(refusal("4 5"), HasSubstr("'4 5'"));
  EXPECT_THAT(refusal("100-128"), HasSubstr("node 128 in '100-128' is out of range; accepted: 1 .. 127"));
  EXPECT_THAT(refusal("0"), HasSubstr("node 0"));
  EXPECT_THAT(refusal("9-4"), HasSubstr("runs backwards"));
  EXPECT_THAT(refusal("4-9,8"), HasSubstr("node 8 in '4-9,8' is given twice"));
  EXPECT_THAT(refusal("2-9"), HasSubstr("node 2 in '2-9' is one of the robot's drives"));
}

TEST(FreeMotors, TurnAsARotorUnderFrictionDoes) {
  const TendonDriveParameters like = Like();
  emulator::RawMaster m(rig::FreeDrives(Nodes(1, 127), like));
  rig::FreeMotors motors(m.rack(), 0, like);
  m.Poll();
  m.Enable(100);
  m.Enable(101);
  const auto run = [&](int ms) {
    for (int i = 0; i < ms; ++i) {
      motors.Poll(m.now());
      m.Run(1);
    }
  };
  const double rated_Nm = 7.056e-3;
  m.Command(0x0F, 500, 100);
  m.Command(0x0F, 20, 101);  // 0.14 mNm, less than the friction
  m.Sync();
  m.Poll();
  run(1);
  run(300);
  // w(t) = (tau - c)/b (1 - exp(-b t / J))
  const auto& p = like.motor;
  const double end_radps = (0.5 * rated_Nm - p.coulomb_friction_Nm) / p.viscous_friction_Nms;
  const double rate = p.viscous_friction_Nms / p.rotor_inertia_kgm2, t = 0.3;
  const double w_radps = end_radps * (1 - std::exp(-rate * t));
  const double angle_rad = end_radps * (t - (1 - std::exp(-rate * t)) / rate);
  const auto rpm = static_cast<std::int32_t>(m.Read(0x606C, 0, 100).number());
  const auto counts = static_cast<std::int32_t>(m.Read(0x6064, 0, 100).number());
  // Steps of 1 ms, each with the torque at its begin: off by at most a step in 300.
  EXPECT_NEAR(rpm, w_radps * 60 / (2 * std::numbers::pi), 0.005 * w_radps * 60 / (2 * std::numbers::pi));
  EXPECT_NEAR(counts, angle_rad * 4096 / (2 * std::numbers::pi),
              0.01 * angle_rad * 4096 / (2 * std::numbers::pi));
  EXPECT_EQ(m.Read(0x6064, 0, 101).number(), 0u) << "below its friction it does not move";
  EXPECT_EQ(m.Read(0x6064, 0, 127).number(), 0u);
  EXPECT_EQ(m.Read(0x6077, 0, 100).number(), 500u);

  m.Command(0x00, 0, 100);
  m.Sync();
  m.Poll();
  run(20'000);
  EXPECT_EQ(m.Read(0x606C, 0, 100).number(), 0u) << "friction ends it";
}

TEST(FreeMotors, CountersWrapAsTheDrivesDo) {
  TendonDriveParameters like = Like();
  like.drive.encoder_counts_per_turn = 1 << 30;
  emulator::RawMaster m(rig::FreeDrives({1}, like));
  rig::FreeMotors motors(m.rack(), 0, like);
  m.Enable();
  m.Command(0x0F, 1000);
  m.Sync();
  m.Poll();
  bool negative = false;
  for (int i = 0; i < 300; ++i) {
    motors.Poll(m.now());
    m.Run(1);
    negative = negative || static_cast<std::int32_t>(m.Read(0x6064, 0).number()) < 0;
  }
  EXPECT_TRUE(negative) << "past 2^31 - 1 it goes on at -2^31";
}

}  // namespace
}  // namespace tendril::rig
