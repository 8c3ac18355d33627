// Runs as a log: what the log's reader gives back is what was written, to the units of the drives.
#include "tendril/gap/run_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <numbers>

#include "tendril/config/config.h"

namespace tendril::gap {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr const char* kRobot = TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml";
constexpr int kRows = 200;

DataSet Set() {
  DataSet set;
  set.robot = config::LoadRobot(kRobot);
  for (const char* name : {"a", "b"}) {
    Run run;
    run.name = name;
    run.time_s = Eigen::VectorXd::LinSpaced(kRows, 0, 0.001 * (kRows - 1));
    for (Eigen::MatrixXd* m :
         {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N})
      m->setZero(kRows, 3);
    for (int i = 0; i < kRows; ++i) {
      run.motor_position_rad(i, 1) = std::sin(0.05 * i);
      run.tension_N(i, 2) = 1 + 0.5 * std::sin(0.03 * i);
      run.torque_actual_Nm(i, 0) = 1e-4 * std::sin(0.02 * i);
    }
    set.runs.push_back(run);
  }
  return set;
}

class RunLog : public testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(log_); }
  const std::string log_ =
      std::filesystem::temp_directory_path() / ("tendril_run_log_" + std::to_string(getpid()) + ".lcmlog");
};

TEST_F(RunLog, ReadsBackAsTheRunsItWasMadeOf) {
  const DataSet set = Set();
  const WrittenLog written = WriteLog(set, log_);
  EXPECT_GE(written.events, 2U * kRows);
  EXPECT_EQ(written.clipped, 0U);
  const DataSet read = LoadLogs({log_}, kRobot);
  ASSERT_EQ(read.runs.size(), 2U);
  const auto& tendons = set.robot.actuation->tendons;
  const double count_rad = 2 * std::numbers::pi / tendons[1].drive.encoder_counts_per_turn,
               mV_N = 1e-3 / tendons[2].load_cell.gain_VpN,
               permille_Nm = 1e-3 * tendons[0].drive.rated_torque_Nm;
  for (const gap::Run& run : read.runs) {
    ASSERT_EQ(run.time_s.size(), kRows);
    EXPECT_LE((run.time_s - set.runs[0].time_s).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LE((run.motor_position_rad - set.runs[0].motor_position_rad).cwiseAbs().maxCoeff(), count_rad);
    EXPECT_LE((run.tension_N - set.runs[0].tension_N).cwiseAbs().maxCoeff(), mV_N);
    EXPECT_LE((run.torque_actual_Nm - set.runs[0].torque_actual_Nm).cwiseAbs().maxCoeff(), permille_Nm);
  }
}

TEST_F(RunLog, WhatTheUnitsCannotHoldIsCounted) {
  DataSet set = Set();
  set.runs[0].torque_actual_Nm(5, 0) = 1e3;
  set.runs[1].torque_actual_Nm(7, 2) = -1e3;
  EXPECT_EQ(WriteLog(set, log_).clipped, 2U);
}

TEST_F(RunLog, ChannelsThatSomeRunLacksAreNamed) {
  DataSet set = Set();
  EXPECT_THAT(WhatALogLoses(set).channels, IsEmpty());
  EXPECT_FALSE(WhatALogLoses(set).start_position);
  set.runs[0].tension_N.resize(kRows, 0);
  set.runs[1].tip_m.setZero(kRows, 3);
  set.runs[1].motor_position_rad.array() += 0.5;
  EXPECT_THAT(WhatALogLoses(set).channels, ElementsAre("orientation", "tension"));
  EXPECT_TRUE(WhatALogLoses(set).start_position);
}

TEST_F(RunLog, AFileThatCannotBeWrittenIsAnError) {
  EXPECT_THROW(WriteLog(Set(), "/no/such/folder/x.lcmlog"), std::runtime_error);
}

}  // namespace
}  // namespace tendril::gap
