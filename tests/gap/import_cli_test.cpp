// `tendril gap import` as a user runs it: folders and logs that are read back, hints, exit codes.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "tendril/gap/data_set.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const std::string kRobot = TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml";

class ImportCommandTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("tendril_import_cli_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string Write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return (folder_ / name).string();
  }
  int Run(const std::string& arguments) {
    const fs::path error = folder_ / "stderr";
    const int status = std::system(
        fmt::format("{} gap import {} >/dev/null 2>{} </dev/null", TENDRIL_BINARY, arguments, error.string())
            .c_str());
    std::ifstream in(error);
    error_.assign(std::istreambuf_iterator<char>(in), {});
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  fs::path folder_;
  std::string error_;
};

TEST_F(ImportCommandTest, AFolderAndALogOfTheSameTablesAgreeWithinTheDrivesUnits) {
  std::string table = "t,d1,d2,d3,i1,i2,i3,f1,f2,f3,c1,c2,c3,x,y,z\n";
  for (int i = 0; i < 600; ++i) {
    const double t = 0.002 * i, s = std::sin(5 * t);
    table += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},", 1000 + t, 4 * s, -2 * s, -2 * s, 0.05 * s,
                         0.02, -0.01, 2 + s, 1.5 - s, 1, 0.05 * s, 0.02, -0.01);
    table += i % 5 == 0 ? fmt::format("{},0,{}\n", 20 * s, 58 - s) : ",,\n";
  }
  const std::string map = Write("map.yaml",
                                "time: {column: t}\n"
                                "runs: {family: sway}\n"
                                "columns:\n"
                                "  motor_position: {names: [d1, d2, d3], unit: mm}\n"
                                "  torque_actual: {names: [i1, i2, i3], unit: A}\n"
                                "  torque_target: {names: [c1, c2, c3], unit: A}\n"
                                "  tension: {names: [f1, f2, f3]}\n"
                                "  tip: {names: [x, y, z], unit: mm}\n");
  const std::string first = Write("first.csv", table), second = Write("second.csv", table);
  const std::string out = (folder_ / "set").string(), log = (folder_ / "set.lcmlog").string();
  ASSERT_EQ(
      Run(fmt::format("--robot {} --map {} {} {} --out {} --log {}", kRobot, map, first, second, out, log)),
      0)
      << error_;
  const DataSet set = LoadDataSet(out, "");
  const DataSet logged = LoadLogs({log}, kRobot);
  ASSERT_EQ(set.runs.size(), 2u);
  ASSERT_EQ(logged.runs.size(), 2u);
  EXPECT_EQ(set.runs[1].name, "second");
  EXPECT_EQ(set.runs[1].family, "sway");
  for (std::size_t r = 0; r < 2; ++r) {
    const gap::Run &a = set.runs[r], &b = logged.runs[r];
    ASSERT_EQ(a.time_s.size(), b.time_s.size());
    EXPECT_LT((a.time_s - b.time_s).cwiseAbs().maxCoeff(), 1e-8);
    // A count, per mille of rated torque, a millivolt at 0.2 V/N: half of each.
    EXPECT_LT((a.motor_position_rad - b.motor_position_rad).cwiseAbs().maxCoeff(),
              0.51 * 2 * std::numbers::pi / 2048);
    EXPECT_LT((a.torque_actual_Nm - b.torque_actual_Nm).cwiseAbs().maxCoeff(), 0.51e-3 * 0.007056);
    EXPECT_LT((a.torque_target_Nm - b.torque_target_Nm).cwiseAbs().maxCoeff(), 0.51e-3 * 0.007056);
    EXPECT_LT((a.tension_N - b.tension_N).cwiseAbs().maxCoeff(), 0.51e-3 / 0.2);
    for (Eigen::Index i = 0; i < a.time_s.size(); ++i) {
      if (i % 5 != 0) {
        EXPECT_TRUE(std::isnan(a.tip_m(i, 0)) && std::isnan(b.tip_m(i, 0)));
      } else {
        EXPECT_LT((a.tip_m.row(i) - b.tip_m.row(i)).norm(), 1e-12);
      }
    }
  }
}

TEST_F(ImportCommandTest, WrongUseAndWrongDataSayWhatToDo) {
  const std::string map = Write("map.yaml", "time: {rate_Hz: 100}\ncolumns: {tip: {names: [x, y, z]}}\n");
  std::string rows = "x,y,z\n";
  for (int i = 0; i < 100; ++i) rows += fmt::format("{},0,58\n", i % 7);
  const std::string table = Write("table.csv", rows);
  const std::string out = (folder_ / "out").string();
  EXPECT_EQ(Run(fmt::format("--robot {} --map {} {}", kRobot, map, table)), 2);
  EXPECT_THAT(error_, HasSubstr("--out or a log by --log"));
  EXPECT_EQ(Run(fmt::format("--robot {} --map {} --out {}", kRobot, map, out)), 2);
  EXPECT_EQ(Run(fmt::format("--robot {} --map {} {}.gone --out {}", kRobot, map, table, out)), 1);
  EXPECT_THAT(error_, HasSubstr("table.csv.gone"));
  EXPECT_EQ(Run(fmt::format("--robot {} --map {} {} --out {}", kRobot, map, table, out)), 0);
  EXPECT_THAT(error_, HasSubstr("these are millimetres; divide by 1000"));
}

}  // namespace
}  // namespace tendril::gap
