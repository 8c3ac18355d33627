// Guards that are accepted and cannot trip: none in the shipped files; each key beyond the robot's scale is
// told with its place, its value and a value that helps. What the scale is comes from the robot's data sheet,
// typed in here.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

struct Idle {
  const char* key;    // as in the message
  const char* line;   // of tendrild.yaml
  const char* works;  // the largest value that still can trip (for slack: the smallest)
  const char* idle;   // the first that cannot
};

// rig_60mm: holes 4 mm out and a bend of 2.6 rad: 10.4 mm of tendon; three tendons, so that 3.467 mm stay
// unexplained; a motor pulls 0.008 m / 19 a radian, so its friction of 2e-4 N m is 0.475 N; 10 N / 0.84 and
// twice that are 12.85 N.
const Idle kKeys[] = {
    {"controller.guards.max_missing_cycles", "max_missing_cycles: 5", "max_missing_cycles: 249",
     "max_missing_cycles: 250"},
    {"controller.guards.slack_tension_N", "slack_tension_N: 0.02", "slack_tension_N: 0.0185",
     "slack_tension_N: 0.015"},
    {"controller.guards.confirm_cycles", "confirm_cycles: 20", "confirm_cycles: 51", "confirm_cycles: 53"},
    {"controller.guards.tension_disagreement_N", "tension_disagreement_N: 2.0", "tension_disagreement_N: 9.9",
     "tension_disagreement_N: 10.0"},
    {"controller.guards.stuck_torque_change_N", "stuck_torque_change_N: 2.0", "stuck_torque_change_N: 12.8",
     "stuck_torque_change_N: 12.9"},
    {"controller.guards.max_displacement_jump_m", "max_displacement_jump_m: 0.0005",
     "max_displacement_jump_m: 0.0103", "max_displacement_jump_m: 0.0105"},
    {"controller.guards.max_displacement_rate_mps", "max_displacement_rate_mps: 0.2",
     "max_displacement_rate_mps: 0.49", "max_displacement_rate_mps: 0.51"},
    {"controller.guards.max_following_error_m", "max_following_error_m: 0.004",
     "max_following_error_m: 0.0103", "max_following_error_m: 0.0105"},
    {"controller.guards.max_bending_excess_rad", "max_bending_excess_rad: 0.3", "max_bending_excess_rad: 3.6",
     "max_bending_excess_rad: 3.7"},
    {"controller.guards.max_estimator_residual_m", "max_estimator_residual_m: 0.002",
     "max_estimator_residual_m: 0.0034", "max_estimator_residual_m: 0.0035"},
    {"controller.guards.max_torque_error_N", "max_torque_error_N: 1.0", "max_torque_error_N: 12.8",
     "max_torque_error_N: 12.9"},
    {"controller.guards.max_late_cycles", "max_late_cycles: 100", "max_late_cycles: 249",
     "max_late_cycles: 251"},
    {"controller.guards.max_stream_silence_s", "max_stream_silence_s: 1.0", "max_stream_silence_s: 59.0",
     "max_stream_silence_s: 61.0"},
    {"controller.take_up.max_travel_m", "max_travel_m: 0.03", "max_travel_m: 0.14", "max_travel_m: 0.16"},
    {"bus.heartbeat_timeout_ms", "heartbeat_timeout_ms: 250", "heartbeat_timeout_ms: 1999",
     "heartbeat_timeout_ms: 2001"},
};

std::vector<std::string> IdleIn(const std::string& text) {
  // The file is read again for the line of a key.
  const std::string path = (std::filesystem::temp_directory_path() / "tendril_idle_guards.yaml").string();
  std::ofstream(path) << text;
  const auto lines = IdleGuards(ParseDaemon(text, path), LoadRobot(ConfigPath("robots/rig_60mm.yaml")), path);
  std::filesystem::remove(path);
  return lines;
}

TEST(IdleGuards, ShippedFilesHaveNone) {
  for (const char* file : {"tendrild.yaml", "tendrild_four_tendon.yaml", "tendrild_two_section.yaml"}) {
    const DaemonParameters daemon = LoadDaemon(ConfigPath(file));
    EXPECT_THAT(IdleGuards(daemon, LoadRobot(daemon.robot_file), ConfigPath(file)), IsEmpty()) << file;
  }
}

TEST(IdleGuards, EachKeyIsToldFromTheValueOnThatCannotTrip) {
  const std::string text = ReadText(ConfigPath("tendrild.yaml"));
  for (const Idle& k : kKeys) {
    SCOPED_TRACE(k.key);
    EXPECT_THAT(IdleIn(Edited(text, k.line, k.works)), IsEmpty());
    const std::string edited = Edited(text, k.line, k.idle);
    const std::string place =
        "tendril_idle_guards.yaml:" + std::to_string(LineWith(edited, k.idle)) + ": " + k.key;
    const std::string value = std::string(k.idle).substr(std::string(k.idle).find(' ') + 1);
    EXPECT_THAT(IdleIn(edited),
                ElementsAre(AllOf(HasSubstr(place), HasSubstr(" cannot trip on rig_60mm: "),
                                  HasSubstr(": " + value.substr(0, value.find(".0"))), HasSubstr("; set "))));
  }
}

// What is suggested is not told again.
TEST(IdleGuards, WhatIsSuggestedCanTrip) {
  const std::string text = ReadText(ConfigPath("tendrild.yaml"));
  for (const Idle& k : kKeys) {
    SCOPED_TRACE(k.key);
    const auto lines = IdleIn(Edited(text, k.line, k.idle));
    ASSERT_EQ(lines.size(), 1u);
    const std::string rest = lines[0].substr(lines[0].rfind("; set ") + 6);
    const std::string suggested = rest.substr(0, rest.find(' '));
    const std::string name = std::string(k.line).substr(0, std::string(k.line).find(' ') + 1);
    EXPECT_THAT(IdleIn(Edited(text, k.line, name + suggested)), IsEmpty()) << lines[0];
  }
}

// A load cell so coarse that its input ends below the limit.
TEST(IdleGuards, AMarginBeyondWhatTheCellShows) {
  const DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild.yaml"));
  RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  robot.actuation->tendons[1].load_cell.gain_VpN = 1.1;  // 10 V are 9.09 N; 8.8 N at the base are a fault
  EXPECT_THAT(IdleGuards(daemon, robot, ConfigPath("tendrild.yaml")), IsEmpty());
  robot.actuation->tendons[1].load_cell.gain_VpN = 1.2;
  EXPECT_THAT(IdleGuards(daemon, robot, ConfigPath("tendrild.yaml")),
              ElementsAre(AllOf(HasSubstr("controller.guards.tension_margin: 0.1 cannot trip"),
                                HasSubstr("tendon 2 shows no more than 8.33 N"))));
}

}  // namespace
}  // namespace tendril::config
