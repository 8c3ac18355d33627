// What a daemon's files ask for together, judged without a bus: the shipped ones pass, and each kind of
// impossible or pointless request is named with its key.
#include "tendril/daemon/file_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tendril/config/config.h"

namespace tendril::daemon {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class FileCheck : public testing::Test {
 protected:
  std::string Refusal() const {
    try {
      CheckedText(daemon_, robot_, path_);
    } catch (const config::ConfigError& e) {
      return e.what();
    }
    return "";
  }

  const std::string path_ = TENDRIL_SOURCE_DIR "/config/tendrild.yaml";
  DaemonParameters daemon_ = config::LoadDaemon(path_);
  RobotParameters robot_ = config::LoadRobot(daemon_.robot_file);
};

TEST_F(FileCheck, TheTextIsTheSameFileAgainWithComments) {
  const std::string text = CheckedText(daemon_, robot_, path_);
  EXPECT_THAT(text, HasSubstr("\n# "));
  EXPECT_EQ(config::ToYaml(config::ParseDaemon(text, "text")), config::ToYaml(daemon_));
}

TEST_F(FileCheck, ABusThatIsTooSlowIsRefusedAtTheCycle) {
  daemon_.bus.max_load = 0.01;
  EXPECT_THAT(Refusal(), HasSubstr("bus.cycle_ns"));
  EXPECT_THAT(Refusal(), HasSubstr("1.0 % (bus.max_load)"));
}

TEST_F(FileCheck, TensionFeedbackNeedsACellAtEveryTendon) {
  daemon_.controller.tension_feedback = true;
  EXPECT_THAT(CheckedText(daemon_, robot_, path_), HasSubstr("# tension feedback: bandwidth "));
  robot_.actuation->tendons[1].load_cell.place = LoadCellPlace::kNone;
  EXPECT_THAT(Refusal(), HasSubstr("controller.tension_feedback: on, but tendon 2 has no load cell"));
}

TEST_F(FileCheck, LimitsThatDelayEveryMotionAreWarnedOf) {
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_), Not(Contains(HasSubstr("delay every motion"))));
  TrajectoryParameters& t = daemon_.controller.trajectory;
  t.max_jerk_radps3 = t.max_acceleration_radps2 / 0.7;  // 0.7 s to the greatest acceleration
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_), Contains(HasSubstr("delay every motion by 0.7")));
}

TEST_F(FileCheck, AKeyThatCannotBeReadIsWarnedOf) {
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_), Not(Contains(HasSubstr("key"))));
  daemon_.lcm.key_file = "/nonexistent/key";
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_),
              Contains(AllOf(HasSubstr("lcm.key_file: key file /nonexistent/key"), HasSubstr("make one"))));
}

TEST_F(FileCheck, BendsThatTheTendonsDoNotHoldAreWarnedOf) {
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_), Not(Contains(HasSubstr("limits.max_bending_rad"))));
  robot_.limits.max_tension_base_N = 2 * robot_.limits.min_tension_N;
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_), Contains(HasSubstr("limits.max_bending_rad")));
}

TEST_F(FileCheck, ACpuThatIsNotHereIsWarnedOf) {
  daemon_.realtime.cpu = 1000;  // beyond what the system's set of CPUs can hold
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_),
              Contains(HasSubstr("realtime.cpu: 1000 is not available")));
  daemon_.realtime.cpu = -1;
  EXPECT_THAT(FileWarnings(daemon_, robot_, path_), Not(Contains(HasSubstr("realtime.cpu"))));
}

TEST_F(FileCheck, DirectionsAreNamedWhereSomeAreNotHeld) {
  EXPECT_EQ(DirectionsComment(robot_), "");
  robot_.body.sections[0].tendons.resize(1);
  EXPECT_THAT(DirectionsComment(robot_),
              HasSubstr("# directions of " + robot_.name + ": one tendon bends it"));
}

}  // namespace
}  // namespace tendril::daemon
