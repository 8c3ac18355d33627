// Values that are accepted and make no sense: none in the shipped files; each key beyond the robot's scale is
// reported with its place, its value and a value that helps. What the scale is comes from the robot's data
// sheet, typed in here.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

struct Idle {
  const char* key;   // as in the message
  const char* line;  // of tendrild.yaml
  const char*
      works;  // the largest value without a warning, four fifths of what is idle (for slack: the smallest)
  const char* late;  // the first with one; empty: idle from there on
  const char* idle;  // the first that cannot trip
};

// rig_60mm: holes 4 mm out and a bend of 2.6 rad: 10.4 mm of tendon; three tendons, so that 3.467 mm stay
// unexplained; a motor pulls 0.008 m / 19 a radian, so its friction of 2e-4 N m is 0.475 N; 10 N / 0.84 and
// twice that are 12.85 N.
const Idle kKeys[] = {
    {"controller.guards.max_missing_cycles", "max_missing_cycles: 5", "max_missing_cycles: 200",
     "max_missing_cycles: 201", "max_missing_cycles: 250"},
    {"controller.guards.slack_tension_N", "slack_tension_N: 0.02", "slack_tension_N: 0.0185", "",
     "slack_tension_N: 0.015"},
    {"controller.guards.confirm_cycles", "confirm_cycles: 20", "confirm_cycles: 41", "confirm_cycles: 42",
     "confirm_cycles: 53"},
    {"controller.guards.tension_disagreement_N", "tension_disagreement_N: 2.0", "tension_disagreement_N: 8.0",
     "tension_disagreement_N: 8.1", "tension_disagreement_N: 10.0"},
    {"controller.guards.stuck_torque_change_N", "stuck_torque_change_N: 2.0", "stuck_torque_change_N: 10.2",
     "stuck_torque_change_N: 10.3", "stuck_torque_change_N: 12.9"},
    {"controller.guards.max_displacement_jump_m", "max_displacement_jump_m: 0.0005",
     "max_displacement_jump_m: 0.0083", "max_displacement_jump_m: 0.0084", "max_displacement_jump_m: 0.0105"},
    {"controller.guards.max_displacement_rate_mps", "max_displacement_rate_mps: 0.2",
     "max_displacement_rate_mps: 0.4", "max_displacement_rate_mps: 0.41", "max_displacement_rate_mps: 0.51"},
    {"controller.guards.max_following_error_m", "max_following_error_m: 0.004",
     "max_following_error_m: 0.0083", "max_following_error_m: 0.0084", "max_following_error_m: 0.0105"},
    {"controller.guards.max_bending_excess_rad", "max_bending_excess_rad: 0.3", "max_bending_excess_rad: 2.9",
     "max_bending_excess_rad: 3.0", "max_bending_excess_rad: 3.7"},
    {"controller.guards.max_estimator_residual_m", "max_estimator_residual_m: 0.002",
     "max_estimator_residual_m: 0.0027", "max_estimator_residual_m: 0.0028",
     "max_estimator_residual_m: 0.0035"},
    {"controller.guards.max_torque_error_N", "max_torque_error_N: 1.0", "max_torque_error_N: 10.2",
     "max_torque_error_N: 10.3", "max_torque_error_N: 12.9"},
    {"controller.guards.max_late_cycles", "max_late_cycles: 100", "max_late_cycles: 200",
     "max_late_cycles: 201", "max_late_cycles: 251"},
    {"controller.guards.max_stream_silence_s", "max_stream_silence_s: 1.0", "max_stream_silence_s: 48.0",
     "max_stream_silence_s: 49.0", "max_stream_silence_s: 61.0"},
    {"controller.take_up.max_travel_m", "max_travel_m: 0.03", "max_travel_m: 0.119", "max_travel_m: 0.121",
     "max_travel_m: 0.16"},
    {"bus.heartbeat_timeout_ms", "heartbeat_timeout_ms: 250", "heartbeat_timeout_ms: 1600",
     "heartbeat_timeout_ms: 1601", "heartbeat_timeout_ms: 2001"},
};

// Tests of this file run beside each other.
std::string FileOfThisTest() { return "tendril_warnings_" + std::to_string(getpid()) + ".yaml"; }

std::vector<std::string> WarnedOf(const std::string& text) {
  // The file is read again for the line of a key.
  const std::string path = (std::filesystem::temp_directory_path() / FileOfThisTest()).string();
  std::ofstream(path) << text;
  const auto lines = Warnings(ParseDaemon(text, path), LoadRobot(ConfigPath("robots/rig_60mm.yaml")), path);
  std::filesystem::remove(path);
  return lines;
}

TEST(Warnings, ShippedFilesHaveNone) {
  for (const char* file :
       {"tendrild.yaml", "tendrild_four_tendon.yaml", "tendrild_two_section.yaml", "tendrild_pairs.yaml"}) {
    const DaemonParameters daemon = LoadDaemon(ConfigPath(file));
    EXPECT_THAT(Warnings(daemon, LoadRobot(daemon.robot_file), ConfigPath(file)), IsEmpty()) << file;
  }
}

auto Told(const std::string& edited, const char* line, const char* key, const char* what) {
  const std::string place = FileOfThisTest() + ":" + std::to_string(LineWith(edited, line)) + ": " + key;
  const std::string value = std::string(line).substr(std::string(line).find(' ') + 1);
  return AllOf(HasSubstr(place), HasSubstr(what), HasSubstr(": " + value.substr(0, value.find(".0"))),
               HasSubstr("; set "));
}

TEST(Warnings, EachGuardThatIsLateOrCannotTripIsWarnedOf) {
  const std::string text = ReadText(ConfigPath("tendrild.yaml"));
  for (const Idle& k : kKeys) {
    SCOPED_TRACE(k.key);
    EXPECT_THAT(WarnedOf(Edited(text, k.line, k.works)), IsEmpty());
    const std::string idle = Edited(text, k.line, k.idle);
    // Another key may be measured by this one.
    EXPECT_THAT(WarnedOf(idle), Contains(Told(idle, k.idle, k.key, " cannot trip on rig_60mm: ")));
    if (*k.late == '\0') continue;
    const std::string late = Edited(text, k.line, k.late);
    EXPECT_THAT(WarnedOf(late),
                ElementsAre(Told(late, k.late, k.key, " % of a value that cannot trip on rig_60mm: ")));
  }
}

// What are no guards. 8 N in less than 0.1 s; friction of 0.475 N and 0.3 N / 0.8 of pretension; a state a
// second.
const Idle kOthers[] = {
    {"controller.pretension_ramp_Nps", "pretension_ramp_Nps: 2.0", "pretension_ramp_Nps: 79.0",
     "pretension_ramp_Nps: 81.0", " N/s is a jerk on rig_60mm: "},
    {"controller.take_up.pull_N", "pull_N: 2.0", "pull_N: 0.9", "pull_N: 0.8",
     " N cannot wind in the tendon on rig_60mm: friction of its motor and pretension take 0.8"},
    {"controller.take_up.max_speed_mps", "max_speed_mps: 0.005", "max_speed_mps: 0.2", "max_speed_mps: 0.21",
     " m/s trips a guard of rig_60mm: homing would wind faster than"},
    {"controller.guards.max_torque_error_N", "max_torque_error_N: 1.0", "max_torque_error_N: 0.02",
     "max_torque_error_N: 0.01",
     " N trips on noise on rig_60mm: the reported torque of tendon 1 stays off by"},
    {"lcm.state_every_cycles", "state_every_cycles: 1 ", "state_every_cycles: 1000 ",
     "state_every_cycles: 1001 ", " hides rig_60mm: a state comes every 1 s"},
};

TEST(Warnings, UnreasonableValuesAreWarnedOf) {
  const std::string text = ReadText(ConfigPath("tendrild.yaml"));
  for (const Idle& k : kOthers) {
    SCOPED_TRACE(k.key);
    EXPECT_THAT(WarnedOf(Edited(text, k.line, k.works)), IsEmpty());
    const std::string edited = Edited(text, k.line, k.late);
    EXPECT_THAT(WarnedOf(edited), ElementsAre(Told(edited, k.late, k.key, k.idle)));
  }
}

// A suggested value raises no further warning.
TEST(Warnings, SuggestedValuesRaiseNoWarning) {
  const std::string text = ReadText(ConfigPath("tendrild.yaml"));
  std::vector<Idle> all(std::begin(kKeys), std::end(kKeys));
  for (const Idle& k : kOthers) all.push_back({k.key, k.line, k.works, "", k.late});
  for (const Idle& k : all) {
    SCOPED_TRACE(k.key);
    std::string line;
    for (const std::string& l : WarnedOf(Edited(text, k.line, k.idle)))
      if (l.find(std::string(k.key) + ":") != std::string::npos) line = l;
    ASSERT_FALSE(line.empty());
    const std::string rest = line.substr(line.rfind("; set ") + 6);
    const std::string suggested = rest.substr(0, rest.find(' '));
    const std::string name = std::string(k.line).substr(0, std::string(k.line).find(' ') + 1);
    EXPECT_THAT(WarnedOf(Edited(text, k.line, name + suggested + " ")), IsEmpty()) << line;
  }
}

TEST(Warnings, AnAddressWithinTheProcessOnly) {
  DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild.yaml"));
  const RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  daemon.lcm.url = "memq://";
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")),
              ElementsAre(AllOf(HasSubstr("lcm.url: 'memq://' reaches no program outside"),
                                HasSubstr("; set udpm://"))));
}

TEST(Warnings, CommandsOfANetworkWithoutAKey) {
  DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild.yaml"));
  const RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  daemon.lcm.url = "udpm://239.255.76.67:7667?ttl=1";
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")),
              ElementsAre(AllOf(HasSubstr("lcm.url: ttl=1: every computer of the network can command"),
                                HasSubstr("lcm.key_file"))));
}

TEST(Warnings, CommandsThatCrossRouters) {
  DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild.yaml"));
  const RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  daemon.lcm.key_file = "/etc/tendril/key";
  daemon.lcm.url = "udpm://239.255.76.67:7667?ttl=1";
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")), IsEmpty());
  daemon.lcm.url = "udpm://239.255.76.67:7667?ttl=99";
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")),
              ElementsAre(AllOf(HasSubstr("lcm.url: ttl=99: commands"), HasSubstr("; set ttl=0"))));
}

TEST(Warnings, UnreasonableRobots) {
  const DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild.yaml"));
  const RobotParameters usual = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  const auto told = [&](auto&& change) {
    RobotParameters robot = usual;
    change(robot);
    return Warnings(daemon, robot, ConfigPath("tendrild.yaml"));
  };
  EXPECT_THAT(
      told([](RobotParameters& r) { r.limits.max_tension_motor_N = 7; }),
      ElementsAre(AllOf(HasSubstr("rig_60mm.yaml"), HasSubstr("limits.max_tension_motor_N: 7: friction"))));
  EXPECT_THAT(told([](RobotParameters& r) {
                for (TendonDriveParameters& t : r.actuation->tendons) t.gear.efficiency = 0.01;
              }),
              Contains(AllOf(HasSubstr("take_up.pull_N: 2 N cannot wind in"), HasSubstr("allows no pull"),
                             Not(HasSubstr("; set")))));
  EXPECT_THAT(told([](RobotParameters& r) { r.body.sections[0].bending_damping_Nms = 0.12; }), IsEmpty());
  EXPECT_THAT(
      told([](RobotParameters& r) { r.body.sections[0].bending_damping_Nms = 0.2; }),
      ElementsAre(AllOf(HasSubstr("sections[1].bending_damping_Nms: 0.2: at"), HasSubstr("takes 6.25 N"),
                        HasSubstr("; set 0.11 or less"), HasSubstr("default_speed_radps 0.28 or less"))));
  EXPECT_THAT(told([](RobotParameters& r) { r.actuation->tendons[1].load_cell.noise_N = 5; }),
              Contains(AllOf(HasSubstr("noise_N: 5: single readings"), HasSubstr("does not stay armed"))));
  EXPECT_THAT(told([](RobotParameters& r) { r.actuation->tendons[1].load_cell.noise_N = 0.3; }),
              Contains(AllOf(HasSubstr("noise_N: 0.3: single readings"), HasSubstr("under tensions within"),
                             HasSubstr("tension_margin of 0.21 or more"))));
  EXPECT_THAT(told([](RobotParameters& r) { r.actuation->tendons[1].load_cell.resolution_V = 1; }),
              ElementsAre(AllOf(HasSubstr("resolution_V: 1: one step"), HasSubstr("limits.min_tension_N"))));
  EXPECT_THAT(told([](RobotParameters& r) { r.actuation->tendons[2].drive.current_limit_A = 100; }),
              ElementsAre(AllOf(HasSubstr("current_limit_A: 100: that is"), HasSubstr("rated torque; set"))));
}

// A load cell so coarse that its input ends below the limit.
TEST(Warnings, AMarginBeyondWhatTheCellShows) {
  const DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild.yaml"));
  RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  robot.actuation->tendons[1].load_cell.gain_VpN = 1.1;  // 10 V are 9.09 N; 8.8 N at the base are a fault
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")), IsEmpty());
  robot.actuation->tendons[1].load_cell.gain_VpN = 1.2;
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")),
              ElementsAre(AllOf(HasSubstr("controller.guards.tension_margin: 0.1 cannot trip"),
                                HasSubstr("tendon 2 shows no more than 8.33 N"))));
}

TEST(Warnings, FeedbackOnSectionsThatDoNotNeedIt) {
  DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild_two_section.yaml"));
  const RobotParameters robot = LoadRobot(ConfigPath("robots/two_section.yaml"));
  daemon.controller.law = ControlLaw::kEquilibrium;
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild_two_section.yaml")), IsEmpty());
  daemon.controller.tension_feedback = true;
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild_two_section.yaml")),
              ElementsAre(AllOf(HasSubstr("controller.tension_feedback: on, but two_section has 2 sections"),
                                HasSubstr("or set off"))));
}

TEST(Warnings, ShapeFeedbackWithACellBehindThePulleys) {
  DaemonParameters daemon = LoadDaemon(ConfigPath("tendrild.yaml"));
  RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  daemon.controller.law = ControlLaw::kEquilibrium;
  daemon.controller.tension_feedback = daemon.controller.shape_feedback = true;
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")), IsEmpty());
  robot.actuation->tendons[1].load_cell.place = LoadCellPlace::kRobotSide;
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")),
              ElementsAre(AllOf(HasSubstr("controller.shape_feedback: on, but the load cell of tendon 2"),
                                HasSubstr("; set off"))));
  daemon.controller.shape_feedback = false;
  EXPECT_THAT(Warnings(daemon, robot, ConfigPath("tendrild.yaml")), IsEmpty());
}

}  // namespace
}  // namespace tendril::config
