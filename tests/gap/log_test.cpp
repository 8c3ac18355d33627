// Runs from the controller's own logs: counts, per mille and millivolts are converted to the motion, torque
// and tension that the simulated robot had.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "tendril/config/config.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kRobot = TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml";

/// State of the plant where the log's run begins, and later.
struct Truth {
  TimeNs time_ns;
  Eigen::Vector3d angle_rad, tension_N, torque_Nm, target_Nm, tip_m;
  bool running;
};

/// A second and a half of a bend, arming and disarming included.
std::vector<Truth> Record(const std::string& path, bool tracker, bool noise,
                          const char* robot_file = kRobot.c_str()) {
  RobotParameters robot = config::LoadRobot(robot_file);
  if (!tracker) robot.actuation->tracker.reset();
  experiment::ClosedLoopOptions options{
      .controller_robot = robot,
      .plant_robot = robot,
      .daemon = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml"),
      .plant = {.seed = 5, .sensor_noise = noise},
      .log_path = path};
  experiment::ClosedLoop loop(options);
  std::vector<Truth> truth;
  const auto step = [&] {
    const CycleRecord& r = loop.Step();
    Truth t;
    t.time_ns = loop.now_ns();
    t.running = r.output.mode == Mode::kRunning;
    for (int j = 0; j < 3; ++j) {
      const auto& s = loop.plant().tendon()[static_cast<std::size_t>(j)];
      t.angle_rad[j] = s.motor_angle_rad;
      t.tension_N[j] = s.tension_motor_N;
      t.torque_Nm[j] = s.motor_torque_Nm;
      t.target_Nm[j] = r.output.torque_target_permille[static_cast<std::size_t>(j)] * 0.007056e-3;
    }
    t.tip_m = loop.plant().TipPose().p_WA;
    truth.push_back(t);
  };
  bool armed = false;
  for (int i = 0; i < 6000 && !(truth.size() > 1 && truth.back().running); ++i) {
    step();
    if (!armed && loop.record().output.mode == Mode::kConfigured) loop.Send(ModeRequest::kArm), armed = true;
  }
  for (int i = 0; i < 750; ++i) {
    if (i % 10 == 0) {
      Command command;
      command.kind = CommandKind::kBending;
      command.bending_rad = BendingVector::Zero(2);
      command.bending_rad[0] = 0.5;
      loop.Send(command);
    }
    step();
  }
  loop.DisarmAndWait();
  while (!truth.back().running) truth.pop_back();
  return truth;
}

class LogTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("tendril_gap_log_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "bend");
    log_ = folder_ / "bend" / "run.lcmlog";
  }
  void TearDown() override { fs::remove_all(folder_); }
  gap::Run Load(const std::string& robot = "") const {
    const DataSet set = LoadLogs({(folder_ / "bend").string()}, robot);
    EXPECT_EQ(set.runs.size(), 1u);
    return set.runs.at(0);
  }
  fs::path folder_, log_;
};

TEST_F(LogTest, CountsPermilleAndMillivoltsBecomeWhatTheRobotDid) {
  const std::vector<Truth> truth = Record(log_.string(), true, false);
  const gap::Run run = Load(kRobot);
  EXPECT_EQ(run.name, "bend");
  EXPECT_THAT(run.notes, IsEmpty());
  EXPECT_THAT(run.warnings, IsEmpty());
  EXPECT_EQ(run.load_cell, LoadCellPlace::kMotorSide);
  // From half a second before the end of pretension on, until the tensions are let go.
  const auto rows = static_cast<std::size_t>(run.time_s.size());
  ASSERT_LE(rows, truth.size());
  const auto running = static_cast<std::size_t>(
      std::find_if(truth.begin(), truth.end(), [](const Truth& t) { return t.running; }) - truth.begin());
  const std::size_t begin = truth.size() - rows;
  EXPECT_GT(ToSeconds(truth[running].time_ns - truth[begin].time_ns), 0.4);
  EXPECT_LE(ToSeconds(truth[running].time_ns - truth[begin].time_ns), 0.501);
  const Truth& zero = truth[running];
  const double count_rad = 2 * std::numbers::pi / 2048, permille_Nm = 0.007056e-3;
  EXPECT_EQ(run.time_s[0], 0);
  int readings = 0;
  for (Eigen::Index i = 0; i < run.time_s.size(); ++i) {
    const Truth& t = truth[begin + static_cast<std::size_t>(i)];
    EXPECT_NEAR(run.time_s[i], ToSeconds(t.time_ns - truth[begin].time_ns), 1e-12);
    for (int j = 0; j < 3; ++j) {
      EXPECT_NEAR(run.motor_position_rad(i, j), t.angle_rad[j] - zero.angle_rad[j], 1.01 * count_rad);
      EXPECT_NEAR(run.tension_N(i, j), t.tension_N[j], 0.0051);  // 1 mV at 0.2 V/N, half a step and rounding
      EXPECT_NEAR(run.torque_actual_Nm(i, j), t.torque_Nm[j], 0.51 * permille_Nm);
      EXPECT_EQ(run.torque_target_Nm(i, j), t.target_Nm[j]);
    }
    if (!std::isnan(run.tip_m(i, 0))) {
      ++readings;
      EXPECT_LT((run.tip_m.row(i).transpose() - t.tip_m).norm(), 1e-12) << i;
      EXPECT_NEAR(run.tip_quaternion.row(i).norm(), 1, 1e-12);
    }
  }
  // 100 Hz.
  EXPECT_NEAR(readings, 100 * run.time_s[run.time_s.size() - 1], 1.5);
  EXPECT_GT(run.motor_position_rad.cwiseAbs().maxCoeff(), 1);  // it moved
}

TEST_F(LogTest, TheTrackerLeavesTheOtherSensorsNoiseAndTheMotionAsTheyAre) {
  const auto with = Record(log_.string(), true, true);
  const gap::Run a = Load(kRobot);
  const auto without = Record(log_.string(), false, true);
  const gap::Run b = Load(kRobot);
  EXPECT_EQ(a.tip_m.cols(), 3);
  EXPECT_EQ(b.tip_m.cols(), 0);
  EXPECT_EQ(a.tension_N, b.tension_N);
  EXPECT_EQ(a.torque_actual_Nm.bottomRows(700), b.torque_actual_Nm.bottomRows(700));
  EXPECT_EQ(a.motor_position_rad, b.motor_position_rad);
  EXPECT_EQ(with.back().tip_m, without.back().tip_m);
}

TEST_F(LogTest, TheSameSeedWritesTheSameBytes) {
  Record(log_.string(), true, true);
  const std::string first = Load().sha256;
  Record(log_.string(), true, true);
  EXPECT_EQ(Load().sha256, first);
}

TEST_F(LogTest, ALogCarriesItsRobotAndADamagedOneItsBeginning) {
  Record(log_.string(), true, true);
  const Eigen::Index whole = Load().time_s.size();
  fs::resize_file(log_, fs::file_size(log_) / 2);
  const gap::Run run = Load();
  EXPECT_LT(run.time_s.size(), whole);
  EXPECT_GT(run.time_s.size(), whole / 20);
  EXPECT_THAT(run.warnings, Contains(HasSubstr("the log is damaged: the event at byte ")));
}

TEST_F(LogTest, WhatLiesBehindDamageIsUsed) {
  Record(log_.string(), true, true);
  const gap::Run whole = Load();
  std::ifstream in(log_, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), {});
  in.close();
  // The first event, which contains the robot file, and some cycles during the motion.
  bytes.replace(0, 100, 100, '\0');
  bytes.erase(bytes.size() / 2, 20000);
  std::ofstream(log_, std::ios::binary | std::ios::trunc) << bytes;
  const gap::Run run = Load(kRobot);
  EXPECT_LT(run.time_s.size(), whole.time_s.size());
  EXPECT_GT(run.time_s.size(), whole.time_s.size() - 30);
  EXPECT_EQ(run.time_s.tail(1)[0], whole.time_s.tail(1)[0]);
  EXPECT_EQ(run.motor_position_rad.bottomRows(100), whole.motor_position_rad.bottomRows(100));
  EXPECT_THAT(run.warnings, Contains(HasSubstr("is not followed by another; ")));
  EXPECT_THAT(run.notes, Contains(testing::ContainsRegex(
                             "cycles are missing from the log, the first before the event at byte ")));
}

// The events are numbered without a gap, but one cycle's is on no channel that a program writes.
TEST_F(LogTest, AnOverwrittenChannelIsNamedByItsPlace) {
  Record(log_.string(), true, true);
  std::ifstream in(log_, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(in)), {});
  in.close();
  const std::size_t channel = whole.find("TENDRIL_CYCLE", whole.size() / 2);
  const auto overwritten = [&](const std::string& by) {
    std::string bytes = whole;
    std::ofstream(log_, std::ios::binary | std::ios::trunc) << bytes.replace(channel + 8, by.size(), by);
    return Load(kRobot);
  };
  const std::string next = "1 cycle is missing from the log, the first before the event at byte " +
                           std::to_string(whole.find("TENDRIL_CYCLE", channel + 1) - 28);
  EXPECT_THAT(overwritten("XXXX").notes, Contains(next));
  const gap::Run unreadable = overwritten(std::string("\0\1\2\3", 4));
  EXPECT_THAT(unreadable.notes, Contains(next));
  EXPECT_THAT(unreadable.warnings, Contains(HasSubstr("the event at byte " + std::to_string(channel - 28) +
                                                      " has control characters in its channel's name")));
}

// A logger started while the robot moved: positions count from the controller's zero.
TEST_F(LogTest, TheZeroIsTheControllersWhereverTheLogBegins) {
  Record(log_.string(), true, true);
  const gap::Run whole = Load();
  std::ifstream in(log_, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), {});
  in.close();
  bytes.erase(0, bytes.find("\xED\xA1\xDA\x01", bytes.size() / 2));
  std::ofstream(log_, std::ios::binary | std::ios::trunc) << bytes;
  const gap::Run run = Load(kRobot);
  EXPECT_GT(run.motor_position_rad.row(0).cwiseAbs().maxCoeff(), 0.1);
  EXPECT_EQ(run.motor_position_rad.bottomRows(100), whole.motor_position_rad.bottomRows(100));
}

// Random damage: what is read is in order, what cannot be read raises an error. For runs under sanitizers.
TEST_F(LogTest, NoBytesCrashTheReader) {
  Record(log_.string(), true, true);
  std::ifstream in(log_, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(in)), {});
  std::mt19937 random(9);
  int loaded = 0;
  for (int i = 0; i < 40; ++i) {
    // The middle of the log, where the robot moves.
    std::string bytes = whole.substr(0, whole.size() * 2 / 5);
    for (int n = 0; n < 200; ++n)
      bytes[random() % bytes.size()] = static_cast<char>(random() % 4 == 0 ? 255 : random());
    if (i % 4 == 0) {  // only numbers within messages, no lengths: all of it is read
      bytes = whole;
      for (std::size_t at = bytes.find("_CYCLE"); at != bytes.npos; at = bytes.find("_CYCLE", at + 1)) {
        if (random() % 8 == 0 && at + 200 < bytes.size())
          bytes[at + 40 + random() % 40] = static_cast<char>(random());
      }
    }
    std::ofstream(log_, std::ios::binary) << bytes;
    try {
      const gap::Run run = LoadLogs({log_.string()}, kRobot).runs.at(0);
      for (Eigen::Index r = 1; r < run.time_s.size(); ++r) ASSERT_GT(run.time_s[r], run.time_s[r - 1]);
      ++loaded;
    } catch (const std::runtime_error& e) {
      ASSERT_STRNE(e.what(), "");
    }
  }
  EXPECT_GT(loaded, 5);
}

// A log contains the robot file that it was recorded with.
TEST_F(LogTest, ARobotThatIsNotTheLogsIsRefused) {
  Record(log_.string(), true, true);
  const auto refusal = [&](const char* robot) -> std::string {
    try {
      Load(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + robot);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refusal("four_tendon_90mm.yaml"),
              HasSubstr("number of body.sections[0].tendons is 3 there, 4 in the file"));
  const std::string longer = refusal("rig_90mm.yaml");
  EXPECT_THAT(longer, HasSubstr("run.lcmlog: these runs are of another robot than"));
  EXPECT_THAT(longer, HasSubstr("name is rig_60mm there, rig_90mm in the file"));
  EXPECT_EQ(longer.find('\n'), longer.npos);
  // The other runs of a set do not change that.
  fs::create_directories(folder_ / "set");
  fs::copy_file(kRobot, folder_ / "set/robot.yaml");
  std::ofstream(folder_ / "set/a.csv") << "t_s,motor_position_rad_1\n0,0\n0.001,0\n0.002,0\n";
  Record(log_.string(), true, true, TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml");
  EXPECT_THROW(LoadLogs({(folder_ / "set").string(), (folder_ / "bend").string()}, kRobot),
               std::runtime_error);
  EXPECT_EQ(LoadLogs({(folder_ / "bend").string()}, kRobot, OtherRobot::kNoted).runs.size(), 1U);
}

}  // namespace
}  // namespace tendril::gap
