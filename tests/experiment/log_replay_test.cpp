// Replay of logs made by a controller in a loop without losses: nothing differs where nothing was changed,
// and one changed bit is found where it is.
#include "tendril/experiment/log_replay.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <filesystem>
#include <stdexcept>
#include <vector>

#include "control/ideal_loop.h"
#include "tendril/io/log.h"

namespace tendril::experiment {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

double WithBitFlipped(double value, int bit) {
  return std::bit_cast<double>(std::bit_cast<std::uint64_t>(value) ^ (std::uint64_t{1} << bit));
}

struct ReplayTest : testing::Test {
  ReplayTest() {
    DaemonParameters daemon = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
    daemon.controller = control::kParameters;
    run = {config::ToYaml(loop.robot), config::ToYaml(daemon), "1", "abc", 0};
    loop.input.cycle = ~std::uint64_t{0};  // the first step is cycle 0
    for (int j = 0; j < 3; ++j) loop.input.drive[j].state = DriveState::kReady;
    Steps({}, 3);
    Steps(loop.ModeCommand(ModeRequest::kArm), 600);
    Steps(loop.Bending(0.4, -0.3), 700);
  }
  ~ReplayTest() override { fs::remove(path); }

  void Steps(const Command& command, int times) {
    for (int i = 0; i < times; ++i) {
      if (loop.input.cycle + 1 == kSnapshotAt) {
        state.resize(loop.controller.state_bytes());
        loop.controller.SaveState(state);
      }
      loop.Step(i == 0 ? command : Command{});
      CycleRecord& r = records.emplace_back();
      r.input = loop.input;
      r.output = loop.output;
    }
  }
  void Write(std::size_t from, std::size_t gap_from, std::size_t gap_to, bool snapshot) {
    io::RecordLog log(path, {1, loop.robot.body.units(), 3}, "TENDRIL", 0);
    log.Run(run, 0);
    if (snapshot) log.Snapshot(kSnapshotAt, 0, state);
    for (std::size_t i = from; i < records.size(); ++i) {
      if (i < gap_from || i >= gap_to) log.Cycle(records[i]);
    }
    ASSERT_EQ(log.Close(), "");
  }
  std::string WhyNot(const std::optional<RobotParameters>& robot = {}) {
    try {
      experiment::ReplayLog(path, robot);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "replayed";
  }

  static constexpr std::uint64_t kSnapshotAt = 700;
  control::IdealLoop loop;
  std::string path = fs::temp_directory_path() / ("tendril_replay_" + std::to_string(getpid()) + ".lcmlog");
  io::RunInfo run;
  std::vector<CycleRecord> records;
  std::vector<std::byte> state;
};

TEST_F(ReplayTest, AWholeLogGivesTheSameBits) {
  Write(0, 0, 0, false);
  const experiment::ReplayResult r = experiment::ReplayLog(path);
  EXPECT_FALSE(r.difference) << r.difference->field;
  EXPECT_EQ(r.replayed, records.size());
  EXPECT_EQ(r.unchecked, 0U);
  EXPECT_EQ(r.damage, "");
  EXPECT_GT(records.back().output.bending_estimate_rad.norm(), 0.3) << "it moved";
}

TEST_F(ReplayTest, OneChangedBitIsFoundWhereItIs) {
  double& changed = records[812].output.tension_desired_base_N[1];
  const double was = changed;
  changed = WithBitFlipped(was, 0);
  records[850].output.torque_desired_Nm[0] = 1;  // later: not the first
  Write(0, 0, 0, false);
  const experiment::ReplayResult r = experiment::ReplayLog(path);
  ASSERT_TRUE(r.difference);
  EXPECT_EQ(r.difference->cycle, 812U);
  EXPECT_EQ(r.difference->field, "tension_desired_base_N[1]");
  EXPECT_EQ(r.difference->bit, 0);
  EXPECT_THAT(r.difference->replayed, HasSubstr(fmt::format("{:016x}", std::bit_cast<std::uint64_t>(was))));
  EXPECT_THAT(r.difference->logged, HasSubstr(fmt::format("{:016x}", std::bit_cast<std::uint64_t>(was) ^ 1)));
  EXPECT_EQ(r.difference->agree, 0U) << "a later cycle differs as well";
}

// An input that was changed shows in what follows from it.
TEST_F(ReplayTest, AChangedInputShowsInItsCycle) {
  records[500].input.drive[2].analog_mV ^= 1;
  Write(0, 0, 0, false);
  const experiment::ReplayResult r = experiment::ReplayLog(path);
  ASSERT_TRUE(r.difference);
  EXPECT_EQ(r.difference->cycle, 500U);
  EXPECT_EQ(r.difference->field, "tension_measured_N[2]");
}

TEST_F(ReplayTest, FromASnapshotInTheMiddle) {
  Write(kSnapshotAt, 0, 0, true);
  experiment::ReplayResult r = experiment::ReplayLog(path);
  EXPECT_FALSE(r.difference) << r.difference->field;
  EXPECT_TRUE(r.from_snapshot);
  EXPECT_EQ(r.first_cycle, kSnapshotAt);
  EXPECT_EQ(r.replayed, records.size() - kSnapshotAt);
  EXPECT_THAT(WhyNot(loop.robot), HasSubstr("leave out --robot"));

  records[750].output.reference.velocity_radps[0] =
      WithBitFlipped(records[750].output.reference.velocity_radps[0], 3);
  Write(kSnapshotAt, 0, 0, true);
  r = experiment::ReplayLog(path);
  ASSERT_TRUE(r.difference);
  EXPECT_EQ(r.difference->cycle, 750U);
  EXPECT_EQ(r.difference->field, "reference_rate_radps[0]");
  EXPECT_EQ(r.difference->bit, 3);
  EXPECT_EQ(r.difference->agree, records.size() - 751) << "one cycle alone, as in a damaged log";

  state.pop_back();
  Write(kSnapshotAt, 0, 0, true);
  EXPECT_THAT(WhyNot(), HasSubstr("does not fit this build"));
}

TEST_F(ReplayTest, WhatCannotBeKnownIsNotClaimed) {
  Write(0, 650, 651, false);
  const experiment::ReplayResult r = experiment::ReplayLog(path);
  EXPECT_FALSE(r.difference);
  EXPECT_EQ(r.replayed, 650U);
  EXPECT_EQ(r.unchecked, records.size() - 651);
  Write(1, 0, 0, false);
  EXPECT_THAT(WhyNot(), HasSubstr("begins with cycle 1 and without the controller's state"));
}

}  // namespace
}  // namespace tendril::experiment
