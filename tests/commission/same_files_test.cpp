// A record that would not count is refused before any motor pulls.
#include "tendril/commission/same_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>

#include "tendril/config/config.h"

namespace tendril::commission {
namespace {

using testing::HasSubstr;

class SameFiles : public testing::Test {
 protected:
  void SetUp() override { daemon_.commissioning_required = true; }

  /// What is said when the daemon runs with files that differ in this; empty: nothing.
  std::string Said(const std::function<void(RobotParameters&, DaemonParameters&)>& change) const {
    RobotParameters robot = robot_;
    DaemonParameters daemon = daemon_;
    change(robot, daemon);
    try {
      RequireSameFiles({robot, daemon}, {robot_, daemon_}, "my.yaml");
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  }

  DaemonParameters daemon_ = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
  const RobotParameters robot_ = config::LoadRobot(daemon_.robot_file);
};

TEST_F(SameFiles, TheSameWiringIsAccepted) {
  EXPECT_EQ(Said([](auto&, auto&) {}), "");
  EXPECT_EQ(Said([](auto& robot, auto&) { robot.body.sections[0].unit_mass_kg *= 2; }), "");
}

TEST_F(SameFiles, OtherNodesOrMotorsAreNot) {
  EXPECT_THAT(Said([](auto&, auto& daemon) { daemon.bus.nodes[0].node_id += 40; }),
              HasSubstr("my.yaml and its robot file are not what the daemon runs with"));
  EXPECT_THAT(
      Said([](auto& robot, auto&) { robot.actuation->tendons[0].drive.encoder_counts_per_turn *= 2; }),
      HasSubstr("restart tendrild"));
}

TEST_F(SameFiles, ADaemonThatPullsWithLessCannotPullAsTheFileAsks) {
  EXPECT_THAT(Said([](auto&, auto& daemon) { daemon.controller.take_up.pull_N /= 2; }),
              HasSubstr("my.yaml: controller.take_up.pull_N"));
  EXPECT_EQ(Said([](auto&, auto& daemon) { daemon.controller.take_up.pull_N *= 2; }), "");
}

TEST_F(SameFiles, ADaemonThatArmsWithoutTheRecordIsToldSo) {
  EXPECT_THAT(Said([](auto&, auto& daemon) { daemon.commissioning_required = false; }),
              HasSubstr("--simulated"));
  EXPECT_NO_THROW(RequireRecordAsked(daemon_, "my.yaml"));
  DaemonParameters open = daemon_;
  open.commissioning_required = false;
  EXPECT_THROW(RequireRecordAsked(open, "my.yaml"), std::runtime_error);
}

}  // namespace
}  // namespace tendril::commission
