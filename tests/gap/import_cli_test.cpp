// `tendril gap import` as a user runs it: written folders are read back, logs, hints, exit codes.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
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

// With a tip alone nothing can be compared.
const std::string kMotors = "motor_position: {names: [m1, m2, m3]}}\n";

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
    const fs::path error = folder_ / "stderr", output = folder_ / "stdout";
    const int status = std::system(fmt::format("{} gap import {} >{} 2>{} </dev/null", TENDRIL_BINARY,
                                               arguments, output.string(), error.string())
                                       .c_str());
    std::ifstream in(error), out(output);
    error_.assign(std::istreambuf_iterator<char>(in), {});
    out_.assign(std::istreambuf_iterator<char>(out), {});
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  fs::path folder_;
  std::string error_, out_;
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
  const std::string first = Write("first.csv", table),
                    second = Write("second.csv", table.substr(0, table.rfind('\n', table.size() - 2) + 1));
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
  const std::string map =
      Write("map.yaml", "time: {rate_Hz: 100}\ncolumns: {tip: {names: [x, y, z]}, " + kMotors);
  std::string rows = "x,y,z,m1,m2,m3\n";
  for (int i = 0; i < 100; ++i) rows += fmt::format("{},0,58,1,2,3\n", i % 7);
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

TEST_F(ImportCommandTest, InputsAreNeverReplaced) {
  const std::string map =
      Write("map.yaml", "time: {rate_Hz: 100}\ncolumns: {tip: {names: [x, y, z]}, " + kMotors);
  std::string rows = "x,y,z,m1,m2,m3\n";
  for (int i = 0; i < 100; ++i) rows += fmt::format("{},0,58,1,2,3\n", i % 7);
  const std::string table = Write("plain.csv", rows);
  Write("robot.yaml", "# mine\n");
  const auto text = [](const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const std::string command = fmt::format("--robot {} --map {} {} ", kRobot, map, table);
  fs::create_directories(folder_ / "sub");
  for (const std::string& out : {folder_.string(), (folder_ / "sub/..").string()}) {
    for (const char* more : {"", " --overwrite"}) {
      EXPECT_EQ(Run(command + "--out " + out + more), 2);
      EXPECT_THAT(error_, HasSubstr("is the folder of")) << error_;
      EXPECT_EQ(std::count(error_.begin(), error_.end(), '\n'), 1) << error_;
    }
  }
  EXPECT_EQ(Run(command + "--log " + table), 2);
  EXPECT_THAT(error_, HasSubstr("give another --log"));
  EXPECT_EQ(text(table), rows);
  EXPECT_EQ(text(folder_ / "robot.yaml"), "# mine\n");
  EXPECT_FALSE(fs::exists(folder_ / "runs.yaml"));
  // A set of an earlier import is kept unless --overwrite is given.
  const std::string out = (folder_ / "out").string();
  ASSERT_EQ(Run(command + "--out " + out), 0) << error_;
  EXPECT_EQ(Run(command + "--out " + out), 2);
  EXPECT_THAT(error_, HasSubstr("--overwrite"));
  EXPECT_EQ(Run(command + "--overwrite --out " + out), 0) << error_;
}

TEST_F(ImportCommandTest, ARunTooShortToBeDiagnosedAllowsNothing) {
  const std::string map =
      Write("map.yaml", "time: {rate_Hz: 100}\ncolumns: {tip: {names: [x, y, z], unit: mm}, " + kMotors);
  std::string rows = "x,y,z,m1,m2,m3\n";
  for (int i = 0; i < 19; ++i) rows += fmt::format("{},0,58,1,2,3\n", i % 7);
  const auto import = [&](const std::string& table) {
    return Run(
        fmt::format("--robot {} --map {} {} --out {}/o --overwrite", kRobot, map, table, folder_.string()));
  };
  EXPECT_EQ(import(Write("short.csv", rows)), 1);
  EXPECT_THAT(out_, HasSubstr("no run of 20 rows"));
  EXPECT_EQ(import(Write("long.csv", rows + "1,0,58,1,2,3\n")), 0) << error_;
}

TEST_F(ImportCommandTest, AllMissingChannelsOfATableAreReported) {
  const std::string map = Write("map.yaml",
                                "time: {rate_Hz: 100}\n"
                                "columns:\n"
                                "  tip: {names: [x, y, z], unit: mm}\n"
                                "  torque_actual: {names: [i1, i2, i3]}\n"
                                "  motor_position: {names: [m1, m2, m3]}\n");
  std::string rows = "m1,m2,m3,x,y,z,i1,i2,i3,note\n";
  for (int i = 0; i < 100; ++i)
    rows += fmt::format("1,2,3,{},0,58,{},0.001,0.002,\n", i % 7, i == 7 ? "n/a" : i == 9 ? "inf" : "0.001");
  const std::string table = Write("plain.csv", rows + "1,2,3,1,2,58,0.0");
  const std::string out = (folder_ / "out").string();
  ASSERT_EQ(Run(fmt::format("--robot {} --map {} {} --out {}", kRobot, map, table, out)), 0) << error_;
  EXPECT_THAT(error_,
              HasSubstr("plain.csv:102: the last line has no line end and may be truncated; dropped"));
  EXPECT_THAT(error_, HasSubstr("column i1: 1 infinite values taken as missing"));
  EXPECT_THAT(error_, HasSubstr("1 cell with 'n/a' taken as missing, the first in line 9, column i1"));
  // One channel more than the first.
  EXPECT_THAT(error_, HasSubstr("tension: no run has tensions"));
  EXPECT_THAT(error_, HasSubstr("columns of the table that the map does not use: note"));

  const std::string ended = Write("ended.csv", rows + "1,2,3,1,2,58\n\n");
  ASSERT_EQ(Run(fmt::format("--robot {} --map {} {} --out {}e", kRobot, map, ended, out)), 0) << error_;
  EXPECT_THAT(error_, HasSubstr("ended.csv:102: the last line is truncated; dropped"));

  std::string many = "--robot " + kRobot + " --map " + map + " --out " + out + "2";
  for (int i = 0; i < 40; ++i) many += fmt::format(" {}", Write(fmt::format("t{}.csv", i), rows));
  ASSERT_EQ(Run(many), 0) << error_;
  EXPECT_LE(std::count(error_.begin(), error_.end(), '\n'), 25) << error_;
}

// The exit code stops a script that would otherwise continue with incomplete data.
TEST_F(ImportCommandTest, ATableThatIsLeftOutIsAnError) {
  const std::string map =
      Write("map.yaml", "time: {rate_Hz: 100}\ncolumns: {tip: {names: [x, y, z], unit: mm}}\n");
  std::string rows = "x,y,z\n";
  for (int i = 0; i < 100; ++i) rows += fmt::format("{},0,58\n", i % 7);
  const std::string good = Write("good.csv", rows), bad = Write("bad.csv", "x,y\n1,2\n");
  EXPECT_EQ(
      Run(fmt::format("--robot {} --map {} {} {} --out {}/out", kRobot, map, good, bad, folder_.string())),
      1);
  EXPECT_THAT(error_, HasSubstr("one of 2 tables left out (above); the others were written"));
  EXPECT_THAT(error_, HasSubstr("bad.csv:1: no column 'z'"));
  EXPECT_EQ(LoadDataSet(folder_ / "out", "").runs.size(), 1u);
}

TEST_F(ImportCommandTest, TablesWithoutRowsAreNamedWithTheReason) {
  const std::string map = Write("map.yaml", "time: {rate_Hz: 100}\ncolumns: {tip: {names: [x, y, z]}}\n");
  const std::string table = Write("head.csv", "x,y,z\n");
  EXPECT_EQ(Run(fmt::format("--robot {} --map {} {} --out {}/out", kRobot, map, table, folder_.string())), 1);
  EXPECT_THAT(error_, HasSubstr("head.csv: column names without any row"));
  EXPECT_EQ(std::count(error_.begin(), error_.end(), '\n'), 1) << error_;
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

// The import, not only the diagnosis, says which cuts a set allows.
TEST_F(ImportCommandTest, ComparableCutsAreReportedAndNoneIsAnError) {
  std::string rows = "t,f1,f2,f3,m1,theta,phi,qw,qx,qy,qz\n";
  for (int i = 0; i < 100; ++i)
    rows += fmt::format("{},{},1,1,0,{},0,1,0,0,0\n", 0.01 * i, 1 + 0.01 * i, 0.002 * i);
  const std::string table = Write("table.csv", rows);
  const auto run = [&](const std::string& columns) {
    const std::string map = Write("map.yaml", "time: {column: t}\ncolumns:\n" + columns);
    return Run(
        fmt::format("--robot {} --map {} {} --out {}/out --overwrite", kRobot, map, table, folder_.string()));
  };
  const std::string bend = "  bending: {kind: angle_and_plane, names: [theta, phi]}\n",
                    tension = "  tension: {names: [f1, f2, f3]}\n";
  EXPECT_EQ(run(bend), 1);
  EXPECT_THAT(out_, HasSubstr("C4 (no tension or motor position of every tendon)"));
  EXPECT_THAT(
      error_,
      HasSubstr("these runs cannot be compared with a simulation; accepted: load cells or motor positions"));
  EXPECT_EQ(run("  orientation: {names: [qw, qx, qy, qz]}\n"), 1);
  EXPECT_EQ(run(tension), 1);
  EXPECT_THAT(out_, HasSubstr("C4 (no tip position, orientation or bending)"));
  EXPECT_EQ(run(bend + "  motor_position: {names: [m1, null, null]}\n"), 1);
  EXPECT_EQ(run(bend + tension), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("can be compared: C0, C4, C5; not C1 (no target torque and no actual torque)"));
  EXPECT_EQ(run(bend + tension + "  motor_position: {names: [m1, null, null]}\n"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("can be compared: C0, C3 (not tendons 2, 3), C4, C5; not C1"));
}

}  // namespace
}  // namespace tendril::gap
