// Measured runs as files: what is written is read back bit for bit, tables of other programs are read, errors
// are named, and nothing crashes.
#include "tendril/gap/data_set.h"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>

#include "support/own_folder.h"
#include "tendril/config/config.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
const std::string kRobot = TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml";

class DataSetTest : public test::OwnFolder {
 protected:
  void Write(const std::string& name, const std::string& text) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }
  DataSet Load() const { return LoadDataSet(folder_, kRobot); }
  /// The only run of a folder with this one table.
  gap::Run LoadTable(const std::string& text) const {
    Write("a.csv", text);
    return Load().runs.at(0);
  }
  /// The error on loading a folder with this one table.
  std::string Refusal(const std::string& text) const {
    Write("a.csv", text);
    try {
      Load();
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  }

  /// A folder with a robot file of its own and one run.
  DataSet WithRobot() const {
    fs::copy_file(kRobot, folder_ / "robot.yaml", fs::copy_options::overwrite_existing);
    Write("a.csv", "t_s,tension_N_1,tension_N_2\n0,1,2\n0.001,3,4\n");
    return Load();
  }
};

/// A run with every channel, numbers of many magnitudes, and a tracker ten times slower than the rest.
Run FullRun(const std::string& name, int rows) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  Run run;
  run.name = name;
  run.family = "circle";
  run.time_s.setLinSpaced(rows, 0, 1e-3 * (rows - 1));
  const auto fill = [&](Eigen::MatrixXd& m, int columns, double scale) {
    m.resize(rows, columns);
    for (auto& x : m.reshaped()) x = scale * normal(random);
  };
  fill(run.torque_target_Nm, 3, 1e-3);
  fill(run.torque_actual_Nm, 3, 1e-3);
  fill(run.motor_position_rad, 3, 10);
  fill(run.tension_N, 3, 1);
  fill(run.tip_m, 3, 0.05);
  fill(run.tip_quaternion, 4, 1);
  for (int i = 0; i < rows; ++i) {
    run.tip_quaternion.row(i).normalize();
    if (i % 10 == 0) continue;
    run.tip_m.row(i).setConstant(kNone);
    run.tip_quaternion.row(i).setConstant(kNone);
  }
  fill(run.bending_rad, 2, 1e-7);
  return run;
}

bool SameBits(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return false;
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    const double x = a.data()[i], y = b.data()[i];
    if (x != y && !(std::isnan(x) && std::isnan(y))) return false;
  }
  return true;
}

TEST_F(DataSetTest, WhatIsWrittenComesBackBitForBit) {
  DataSet set;
  set.robot = config::LoadRobot(kRobot);
  set.runs.push_back(FullRun("first", 200));
  set.runs.push_back(FullRun("again", 201));
  set.runs[1].repeat_of = "first";
  set.runs[1].load_cell = LoadCellPlace::kRobotSide;
  set.runs[1].zero_at_rest = true;
  WriteDataSet(set, folder_);
  const DataSet back = LoadDataSet(folder_, "");
  EXPECT_EQ(config::ToYaml(back.robot), config::ToYaml(set.robot));
  ASSERT_EQ(back.runs.size(), 2u);
  EXPECT_THAT(back.notes, IsEmpty());
  for (int i = 0; i < 2; ++i) {
    const gap::Run &a = set.runs[static_cast<std::size_t>(i)], &b = back.runs[static_cast<std::size_t>(i)];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.family, b.family);
    EXPECT_EQ(a.repeat_of, b.repeat_of);
    EXPECT_EQ(a.load_cell, b.load_cell);
    EXPECT_EQ(a.zero_at_rest, b.zero_at_rest);
    EXPECT_THAT(b.notes, IsEmpty());
    EXPECT_THAT(b.warnings, IsEmpty());
    EXPECT_TRUE(SameBits(a.time_s, b.time_s));
    EXPECT_TRUE(SameBits(a.torque_target_Nm, b.torque_target_Nm));
    EXPECT_TRUE(SameBits(a.torque_actual_Nm, b.torque_actual_Nm));
    EXPECT_TRUE(SameBits(a.motor_position_rad, b.motor_position_rad));
    EXPECT_TRUE(SameBits(a.tension_N, b.tension_N));
    EXPECT_TRUE(SameBits(a.tip_m, b.tip_m));
    EXPECT_LT((a.tip_quaternion - b.tip_quaternion)
                  .array()
                  .isNaN()
                  .select(0, a.tip_quaternion - b.tip_quaternion)
                  .cwiseAbs()
                  .maxCoeff(),
              1e-15);
    EXPECT_TRUE(SameBits(a.bending_rad, b.bending_rad));
  }
}

// The digest as sha256sum prints it for "t_s,tension_N_1\n0,1\n1,2\n" is what a reader can check against.
TEST_F(DataSetTest, ARunCarriesTheDigestOfItsFile) {
  const gap::Run run = LoadTable("t_s,tension_N_1,tension_N_2,tension_N_3\n0,1,1,1\n1,2,2,2\n");
  EXPECT_EQ(run.sha256.size(), 64u);
  const std::string out = (folder_ / "digest").string();
  ASSERT_EQ(std::system(("sha256sum < " + (folder_ / "a.csv").string() + " > " + out).c_str()), 0);
  std::string digest;
  std::ifstream(out) >> digest;
  EXPECT_EQ(run.sha256, digest);
}

TEST_F(DataSetTest, TablesOfOtherProgramsAreUnderstood) {
  // Byte order mark, Windows line ends, spaces, quotes, another order, additional columns, words for missing
  // values, a plus sign, an empty line, a comment, another case, a delimiter at the end of each line.
  const gap::Run run = LoadTable(
      "\xEF\xBB\xBF# made by hand\r\n"
      " tension_N_2 , \"T_S\" ,tension_n_1, comment , tension_N_3,\r\n"
      " 2.5,0.0 , +1e0 , fine , nan,\r\n"
      "\r\n"
      "NaN,0.001,\"1.25\",\"a, b\",n/a,\r\n"
      "2.5,0.002,,,4,\r\n");
  ASSERT_EQ(run.time_s.size(), 3);
  EXPECT_TRUE(SameBits(run.time_s, Eigen::Vector3d(0, 0.001, 0.002)));
  Eigen::Matrix3d expected;
  expected << 1, 2.5, kNone, 1.25, kNone, kNone, kNone, 2.5, 4;
  EXPECT_TRUE(SameBits(run.tension_N, expected));
  EXPECT_EQ(run.torque_actual_Nm.cols(), 0);
  EXPECT_EQ(run.family, "unknown");
  EXPECT_THAT(run.notes, Contains(HasSubstr("comment")));
}

TEST_F(DataSetTest, SemicolonsWithDecimalCommasTabsAndSpacesSeparateCells) {
  const Eigen::Vector2d expected(1.5, -2.5e-3);
  for (const char* text :
       {"t_s;tension_N_1\n0;1,5\n0,001;-2,5e-3\n", "t_s\ttension_N_1\n0\t1.5\n0.001\t-2.5e-3\n",
        "t_s tension_N_1\n  0   1.5\n 0.001  -2.5e-3\n", "t_s,tension_N_1\r0,1.5\r0.001,-.0025\r"}) {
    const gap::Run run = LoadTable(text);
    ASSERT_EQ(run.time_s.size(), 2) << text;
    EXPECT_EQ(run.time_s[1], 0.001) << text;
    EXPECT_TRUE(SameBits(run.tension_N.col(0), expected)) << text;
  }
}

TEST_F(DataSetTest, ATendonWithoutASensorIsMissingNotAbsent) {
  const gap::Run run = LoadTable("t_s,tension_N_1,tension_N_3\n0,1,3\n1,1,3\n");
  ASSERT_EQ(run.tension_N.cols(), 3);
  EXPECT_TRUE(run.tension_N.col(1).array().isNaN().all());
  EXPECT_EQ(run.tension_N(0, 2), 3);
  EXPECT_THAT(run.notes, Contains(HasSubstr("tension_N_2")));
}

TEST_F(DataSetTest, APoseThatLacksAColumnIsNotUsed) {
  const gap::Run run = LoadTable("t_s,tension_N_1,tip_x_m,tip_y_m\n0,1,3,1\n1,1,3,1\n");
  EXPECT_EQ(run.tip_m.cols(), 0);
  EXPECT_THAT(run.notes, Contains(HasSubstr("tip_z_m")));
}

// With the patched robot file, the logs in which the gap was found show none.
TEST_F(DataSetTest, TensionsAreTakenByTheCellsOfTheRobotFile) {
  RobotParameters robot = WithRobot().robot;
  const double gain_VpN = robot.actuation->tendons[1].load_cell.gain_VpN;
  robot.actuation->tendons[1].load_cell.gain_VpN = 1.25 * gain_VpN;
  robot.actuation->tendons[1].load_cell.offset_N = 0.5;
  Write("other/robot.yaml", config::ToYaml(robot));
  const DataSet set = LoadDataSet(folder_, (folder_ / "other" / "robot.yaml").string());
  EXPECT_DOUBLE_EQ(set.runs.at(0).tension_N(1, 0), 3);
  EXPECT_DOUBLE_EQ(set.runs.at(0).tension_N(1, 1), 4 / 1.25 - 0.5);
  EXPECT_THAT(set.notes, Contains(HasSubstr("the load cells (tendons 2) have another gain or zero than in")));
  EXPECT_DOUBLE_EQ(Load().runs.at(0).tension_N(1, 1), 4);
}

TEST_F(DataSetTest, QuaternionsOfAnotherNormAreNoRotation) {
  const gap::Run run =
      LoadTable("t_s,tip_qw,tip_qx,tip_qy,tip_qz\n0,1,0,0,0\n1,0,0,0,0\n2,2,0,0,0\n3,0.70710,0.70710,0,0\n");
  EXPECT_TRUE(run.tip_quaternion.row(1).array().isNaN().all());
  EXPECT_TRUE(run.tip_quaternion.row(2).array().isNaN().all());
  EXPECT_NEAR(run.tip_quaternion.row(3).norm(), 1, 1e-15);
  EXPECT_THAT(run.warnings, Contains(HasSubstr("2 orientations")));
}

TEST_F(DataSetTest, RowsBackInTimeAreDroppedGapsAreKeptAndBothAreReported) {
  std::string text = "t_s,tension_N_1\n";
  for (int i = 0; i < 100; ++i) {
    if (i >= 40 && i < 45) continue;
    text += fmt::format("{},{}\n", i * 0.001, i);
    if (i == 20) text += "0.019,-1\n0.02,-1\n,7\n";
  }
  const gap::Run run = LoadTable(text);
  ASSERT_EQ(run.time_s.size(), 95);
  EXPECT_EQ(run.tension_N.col(0).minCoeff(), 0);  // none of the marked rows is left
  EXPECT_THAT(run.warnings,
              Contains(HasSubstr("2 rows whose time does not increase dropped, the first in line 23")));
  EXPECT_THAT(run.warnings, Contains(HasSubstr("1 rows without a time")));
  EXPECT_THAT(run.notes, Contains(HasSubstr("5 rows missing")));
}

TEST_F(DataSetTest, OfAClockThatRestartsTheLongestPartIsRead) {
  std::string text = "t_s,tension_N_1\n";
  for (int i = 0; i < 300; ++i) text += fmt::format("{},{}\n", 0.001 * (i < 100 ? i : i - 97), i);
  const gap::Run run = LoadTable(text);
  ASSERT_EQ(run.time_s.size(), 200);
  EXPECT_EQ(run.tension_N(0, 0), 100);
  EXPECT_EQ(run.time_s[0], 0.003);
  EXPECT_THAT(run.warnings,
              Contains(HasSubstr("the clock restarts 1 time, first in line 102: the longest part")));
}

TEST_F(DataSetTest, RowsOfACoarseClockAreSpreadBetweenItsTicks) {
  for (const double early_s : {0.0, 0.005}) {  // cut short, rounded
    std::string text = "t_s,tension_N_1\n";
    for (int i = 0; i < 300; ++i) {
      if (i >= 100 && i < 140) continue;
      text += fmt::format("{:.2f},{}\n", 0.01 * std::floor((0.001 * i + early_s) / 0.01 + 1e-6), i);
    }
    const gap::Run run = LoadTable(text);
    ASSERT_EQ(run.time_s.size(), 260);
    for (Eigen::Index i = 0; i < 260; ++i) {
      const double late_s = run.time_s[i] - 0.001 * run.tension_N(i, 0);
      EXPECT_NEAR(late_s, early_s, 1e-9) << i;
      EXPECT_TRUE(i == 0 || run.time_s[i] > run.time_s[i - 1]) << i;
    }
    EXPECT_THAT(run.warnings, Contains(HasSubstr("of a clock that ticks every 0.01 s: spread evenly")));
  }
}

TEST_F(DataSetTest, RowsRecordedTwiceAreDropped) {
  std::string text = "t_s,tension_N_1\n";
  for (int i = 0; i < 200; ++i) text += fmt::format("{},{}\n", 0.001 * (i / 2), i / 2);
  const gap::Run run = LoadTable(text);
  EXPECT_EQ(run.time_s.size(), 100);
  EXPECT_THAT(run.warnings, Contains(HasSubstr("100 rows whose time does not increase dropped")));
}

TEST_F(DataSetTest, RowsInNoOrderAreNoRun) {
  for (const int stride : {-1, 89}) {  // backwards; shuffled
    std::string text = "t_s,tension_N_1\n";
    for (int i = 0; i < 300; ++i) text += fmt::format("{},0\n", 0.001 * ((300 + i * (300 + stride)) % 300));
    try {
      LoadTable(text);
      ADD_FAILURE() << "read, stride " << stride;
    } catch (const std::exception& e) {
      EXPECT_THAT(e.what(), HasSubstr("sort the table by its time"));
    }
  }
}

TEST_F(DataSetTest, ASingleTimeThatJumpsAheadDoesNotDropLaterRows) {
  const gap::Run run = LoadTable("t_s,tension_N_1\n0,0\n1,1\n1e9,2\n3,3\n4,4\n5,5\n");
  EXPECT_TRUE(SameBits(run.time_s, (Eigen::VectorXd(5) << 0, 1, 3, 4, 5).finished()));
}

TEST_F(DataSetTest, ATableCutAtAnyByteGivesTheRowsBeforeTheCut) {
  const std::string whole = "t_s,tension_N_1\n0,1.5\n1,2.5\n2,3.5\n3,4.5\n";
  Write("a.csv", whole);
  const gap::Run full = Load().runs.at(0);
  for (std::size_t size = whole.find("2,3.5"); size < whole.size(); ++size) {
    Write("a.csv", whole.substr(0, size));
    const gap::Run run = Load().runs.at(0);
    const Eigen::Index rows = run.time_s.size();
    ASSERT_GE(rows, 2) << size;
    EXPECT_TRUE(SameBits(run.time_s, full.time_s.head(rows))) << size;
    EXPECT_TRUE(SameBits(run.tension_N.col(0), full.tension_N.col(0).head(rows))) << size;
  }
}

TEST_F(DataSetTest, WhatIsWrongIsNamedWithItsLineColumnAndRemedy) {
  const std::string number = Refusal("t_s,tension_N_1\n0,1\n1,1.2.3\n2,1\n");
  EXPECT_THAT(number, HasSubstr("a.csv:3: column tension_N_1: '1.2.3' is not a number; accepted:"));
  EXPECT_THAT(Refusal("t_s,tension_N_1\n0,1\n1\n2,1\n"),
              HasSubstr("a.csv:3: 1 cells in a table of 2 columns"));
  EXPECT_THAT(Refusal("t_s,tension_N_1\n0,1\n1,1,1\n2,1\n"), HasSubstr("a.csv:3: too many cells"));
  EXPECT_THAT(Refusal("time,tension_N_1\n0,1\n1,1\n"),
              HasSubstr("no column t_s (time in seconds); there are: time"));
  EXPECT_THAT(Refusal("t_s,foo\n0,1\n1,1\n"), HasSubstr("no usable column"));
  EXPECT_THAT(Refusal("0,1\n1,1\n"), HasSubstr("no column names"));
  EXPECT_THAT(Refusal(""), HasSubstr("empty"));
  EXPECT_THAT(Refusal("t_s,tension_N_1\n"), HasSubstr("0 usable rows"));
  EXPECT_THAT(Refusal(std::string("\xFF\xFEt\0_\0s\0", 8)), HasSubstr("UTF-16"));
}

TEST_F(DataSetTest, ABrokenRunIsLeftOutWithANoteAndTheRestIsLoaded) {
  Write("good.csv", "t_s,tension_N_1\n0,1\n1,1\n");
  Write("bad.csv", "t_s,tension_N_1\n0,x\n1,1\n");
  Write("unlisted.csv", "t_s,tension_N_1\n0,1\n1,1\n");
  Write("runs.yaml",
        "- {file: bad.csv, family: circle}\n- {file: good.csv, repeat_of: bad.csv, load_cell: robot_side}\n"
        "- {file: missing.csv}\n- {family: circle}\n- 17\n");
  const DataSet set = Load();
  ASSERT_EQ(set.runs.size(), 1u);
  EXPECT_EQ(set.runs[0].name, "good");
  EXPECT_EQ(set.runs[0].repeat_of, "");  // what it repeats is not there
  EXPECT_EQ(set.runs[0].load_cell, LoadCellPlace::kRobotSide);
  EXPECT_THAT(set.notes, Contains(HasSubstr("bad.csv:2: column tension_N_1: 'x'")));
  EXPECT_THAT(set.notes, Contains(HasSubstr("missing.csv")));
  EXPECT_THAT(set.notes, Contains(HasSubstr("an entry without a file")));
  EXPECT_THAT(set.notes, Contains(HasSubstr("unlisted.csv")));
  EXPECT_THAT(set.notes, Contains(HasSubstr("original 'bad' is missing")));
}

TEST_F(DataSetTest, RepetitionsMayNameFilesOrRunsAndLeadToTheFirstOfTheirKind) {
  for (const char* name : {"a", "b", "c", "d", "e"}) {
    Write(std::string(name) + ".csv", "t_s,tension_N_1\n0,1\n1,1\n");
  }
  Write("runs.yaml",
        "runs:\n- {file: a.csv, repeat_of: null}\n- {file: b.csv, repeat_of: a}\n- {file: c.csv, repeat_of: "
        "b.csv}\n"
        "- {file: d.csv, repeat_of: None}\n- {file: e.csv, repeat_of: gone.csv, load_cell: left}\n");
  const DataSet set = Load();
  ASSERT_EQ(set.runs.size(), 5u);
  EXPECT_EQ(set.runs[0].repeat_of, "");
  EXPECT_EQ(set.runs[1].repeat_of, "a");
  EXPECT_EQ(set.runs[2].repeat_of, "a");
  EXPECT_EQ(set.runs[3].repeat_of, "");
  EXPECT_EQ(set.runs[4].repeat_of, "");
  EXPECT_EQ(set.runs[4].load_cell, LoadCellPlace::kMotorSide);  // the robot file's
  EXPECT_THAT(set.notes, Contains(HasSubstr("load_cell 'left'")));
  Write("runs.yaml", "- {file: a.csv, repeat_of: b}\n- {file: b.csv, repeat_of: a}\n");
  EXPECT_THAT(Load().notes, Contains(HasSubstr("repeat_of forms a cycle")));
}

// The resolution of a table with few decimal places is determined before its quaternions are normalised.
TEST_F(DataSetTest, TheStepOfACoarseOrientationIsThatOfItsTable) {
  const auto step = [&](double to) {
    std::string table = "t_s,tip_qw,tip_qx,tip_qy,tip_qz\n";
    for (int i = 0; i < 100; ++i) {
      const double half = 0.005 * i;
      table += fmt::format("{},{},{},0,0\n", i, to * std::round(std::cos(half) / to),
                           to * std::round(std::sin(half) / to));
    }
    return LoadTable(table).tip_quaternion_step;
  };
  EXPECT_DOUBLE_EQ(step(0.01), 0.01);
  EXPECT_DOUBLE_EQ(step(0.001), 0.001);
  EXPECT_EQ(step(1e-9), 0);
}

// A copied run would count as a repetition without noise; an unknown key would be ignored silently.
TEST_F(DataSetTest, CopiesAreLeftOutAndUnknownKeysReported) {
  std::string table = "t_s,tension_N_1\n";
  for (int i = 0; i < 50; ++i) table += fmt::format("{},{}\n", i, i % 7);
  for (const char* name : {"a.csv", "copy.csv"}) Write(name, table);
  Write("runs.yaml", "runs:\n");
  EXPECT_THAT(Load().notes, Contains(HasSubstr("its list is empty; every CSV file is taken")));
}

TEST_F(DataSetTest, ABrokenListStillGivesTheTables) {
  Write("a.csv", "t_s,tension_N_1\n0,1\n1,1\n");
  for (const char* list : {"runs: 7\n", "- [", "\tx: {", "runs:\n", "[]\n", ""}) {
    Write("runs.yaml", list);
    EXPECT_EQ(Load().runs.size(), 1u) << list;
  }
}

TEST_F(DataSetTest, WhatCannotBeLoadedSaysWhy) {
  EXPECT_THROW(LoadDataSet(folder_ / "none", kRobot), std::runtime_error);
  EXPECT_THROW(Load(), std::runtime_error);  // an empty folder
  Write("a.csv", "t_s,tension_N_1\n0,1\n1,1\n");
  try {
    LoadDataSet(folder_, "");
    FAIL() << "a folder without a robot was loaded";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("--robot"));
  }
}

TEST_F(DataSetTest, WhatIsNamedTwiceIsRefused) {
  Write("a.csv", "t_s,motor_position_rad_1\n0,0\n0.001,0\n0.002,0\n");
  Write("b.csv", "t_s,motor_position_rad_1\n0,1\n0.001,1\n0.002,1\n");
  const std::string folder = folder_.string(), a = (folder_ / "a.csv").string();
  const auto refused = [](const std::vector<std::string>& paths) -> std::string {
    try {
      gap::LoadLogs(paths, kRobot);
      return "";
    } catch (const std::runtime_error& e) {
      return e.what();
    }
  };
  EXPECT_THAT(refused({folder, folder + "/."}), HasSubstr("named twice"));
  EXPECT_THAT(refused({a, (folder_ / "b.csv").string(), a}), HasSubstr("a.csv: named twice"));
  EXPECT_THAT(refused({folder, a}), HasSubstr("which is named as well"));
  EXPECT_THAT(refused({a, folder}), HasSubstr("which is named as well"));
  EXPECT_EQ(refused({a, (folder_ / "b.csv").string()}), "");
}

TEST_F(DataSetTest, ALoadCellIsWhereTheRunSaysOrTheRobot) {
  EXPECT_EQ(LoadTable("t_s,tension_N_1\n0,1\n1,1\n").load_cell, LoadCellPlace::kMotorSide);
  EXPECT_EQ(LoadTable("t_s,torque_actual_Nm_1\n0,1\n1,1\n").load_cell, LoadCellPlace::kNone);
  Write("runs.yaml", "- {file: a.csv, load_cell: none}\n");
  const gap::Run without = LoadTable("t_s,tension_N_1\n0,1\n1,1\n");
  EXPECT_EQ(without.load_cell, LoadCellPlace::kNone);
  EXPECT_EQ(without.tension_N.cols(), 0);
}

// Random damage: any bytes either load or raise one exception. For runs under sanitizers.
TEST_F(DataSetTest, NoBytesCrashTheReader) {
  DataSet set;
  set.robot = config::LoadRobot(kRobot);
  set.runs.push_back(FullRun("a", 12));
  WriteDataSet(set, folder_);
  const auto read = [&](const char* name) {
    std::ifstream in(folder_ / name, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  };
  const std::string table = read("a.csv"), list = read("runs.yaml");
  std::mt19937 random(11);
  const auto mutate = [&](std::string text) {
    const std::string bits = std::string(",;\n\r\"\t -+.eE#:[]{}&*!|nan", 26) + '\0' + '\xFF';
    for (int n = static_cast<int>(random() % 3) + 1; n > 0 && !text.empty(); --n) {
      const std::size_t at = random() % text.size();
      switch (random() % 5) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text[at] = bits[random() % bits.size()];
          break;
        case 2:
          text.erase(at, random() % 40);
          break;
        case 3:
          text.insert(at, text.substr(random() % text.size(), random() % 60));
          break;
        default:
          text.resize(at);
          break;
      }
    }
    return text;
  };
  int loaded = 0;
  for (int i = 0; i < 600; ++i) {
    const bool rubbish = i % 10 == 0;
    std::string bytes(rubbish ? random() % 200 : 0, 0);
    for (char& c : bytes) c = static_cast<char>(random());
    Write("a.csv", rubbish && i % 20 == 0 ? bytes : mutate(table));
    Write("runs.yaml", rubbish && i % 20 != 0 ? bytes : (i % 3 == 0 ? mutate(list) : list));
    try {
      const DataSet got = Load();
      for (const gap::Run& run : got.runs) {
        ASSERT_GE(run.time_s.size(), 2);
        for (Eigen::Index r = 1; r < run.time_s.size(); ++r) ASSERT_GT(run.time_s[r], run.time_s[r - 1]);
      }
      ++loaded;
    } catch (const std::exception& e) {
      ASSERT_THAT(std::string(e.what()), Not(IsEmpty()));
    }
  }
  EXPECT_GT(loaded, 60);  // else the damage tested nothing but refusals
}

TEST_F(DataSetTest, TwoRunsOfOneFileAreNotWritten) {
  DataSet set;
  set.robot = config::LoadRobot(kRobot);
  for (const char* name : {"circle", "circle.csv"}) set.runs.push_back(FullRun(name, 100));
  try {
    WriteDataSet(set, folder_);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("two runs would be written to 'circle.csv'"));
  }
}

// 60 s at 1 kHz. The bound leaves room for slow machines and sanitizers; the time is printed.
TEST_F(DataSetTest, AMinuteIsReadInAFractionOfASecond) {
  DataSet set;
  set.robot = config::LoadRobot(kRobot);
  set.runs.push_back(FullRun("minute", 60000));
  WriteDataSet(set, folder_);
  const std::clock_t start = std::clock();  // of the processor: other programs do not count
  const DataSet back = LoadDataSet(folder_, kRobot);
  const double took = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  std::printf("%.1f MB read in %.3f s\n", static_cast<double>(fs::file_size(folder_ / "minute.csv")) * 1e-6,
              took);
  EXPECT_EQ(back.runs.at(0).time_s.size(), 60000);
  EXPECT_LT(took, 2);
}

const char* const kPlainTable =
    "t_s,motor_position_rad_1,motor_position_rad_2,motor_position_rad_3\n0,0,0,0\n0.001,0,0,0\n";

TEST_F(DataSetTest, RunsFromBeforeAreNamedInTheListAndComeBack) {
  Write("old.csv", kPlainTable);
  Write("new.csv", kPlainTable);
  Write("lost.csv", kPlainTable);
  Write("runs.yaml",
        "runs:\n- {file: old.csv, family: circle}\n- {file: new.csv, family: circle, before: old.csv}\n"
        "- {file: lost.csv, family: circle, before: gone.csv}\n");
  const DataSet set = Load();
  ASSERT_EQ(set.runs.size(), 3U);
  EXPECT_EQ(set.runs[1].before, "old");
  EXPECT_TRUE(IsBefore(set, set.runs[0]));
  EXPECT_FALSE(IsBefore(set, set.runs[1]));
  EXPECT_EQ(set.runs[2].before, "");
  EXPECT_THAT(set.notes, Contains(HasSubstr("gone")));
  WriteDataSet(set, folder_ / "again");
  EXPECT_EQ(LoadDataSet(folder_ / "again", "").runs[1].before, "old");
}

TEST_F(DataSetTest, RunsBelongTogetherByNameOrAsTheOnlyOnesOfTheirKind) {
  for (const char* file :
       {"then/circle_1.csv", "then/triangle_1.csv", "now/circle_1.csv", "now/ramps.csv", "now/new.csv"})
    Write(file, kPlainTable);
  Write("then/runs.yaml", "[{file: circle_1.csv, family: circle}, {file: triangle_1.csv, family: triangle}]");
  Write("now/runs.yaml",
        "[{file: circle_1.csv, family: circle}, {file: ramps.csv, family: triangle}, {file: new.csv, family: "
        "hold}]");
  DataSet set = LoadDataSet(folder_ / "now", kRobot);
  const DataSet then = LoadDataSet(folder_ / "then", kRobot);
  CompareWithBefore(set, then);
  ASSERT_EQ(set.runs.size(), 4U);  // a run of a kind that was not there before is left out
  EXPECT_EQ(set.runs[0].before, "circle_1@before");
  EXPECT_EQ(set.runs[1].before, "triangle_1@before");
  EXPECT_TRUE(IsBefore(set, set.runs[2]));
  EXPECT_TRUE(IsBefore(set, set.runs[3]));
  EXPECT_THAT(set.notes, Contains(HasSubstr("new")));

  DataSet other = LoadDataSet(folder_ / "now", kRobot);
  std::erase_if(other.runs, [](const gap::Run& run) { return run.name != "new"; });
  EXPECT_THROW(CompareWithBefore(other, then), std::runtime_error);
}

// A folder names the robot of its runs; --robot may name another file of that robot, not another robot.
class OtherRobotTest : public DataSetTest {
 protected:
  /// Loads a run of this robot with the rig's own file.
  DataSet LoadRunOf(const RobotParameters& recorded, OtherRobot other = OtherRobot::kRefused) {
    Write("a.csv", "t_s,motor_position_rad_1\n0,0\n0.001,0\n0.002,0\n");
    Write("robot.yaml", config::ToYaml(recorded));
    return LoadDataSet(folder_, kRobot, other);
  }
  std::string RefusalOf(const RobotParameters& recorded) {
    try {
      LoadRunOf(recorded);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  }

  RobotParameters rig_ = config::LoadRobot(kRobot);
};

TEST_F(OtherRobotTest, IsRefusedWithEveryEntryThatDiffers) {
  const std::string longer = RefusalOf(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml"));
  EXPECT_THAT(longer, HasSubstr("robot.yaml: these runs are of another robot than " + kRobot));
  EXPECT_THAT(longer, HasSubstr("name is rig_90mm there, rig_60mm in the file"));
  EXPECT_THAT(longer, HasSubstr("body.sections[0] is 0.09 m there, 0.06 m in the file"));
  EXPECT_THAT(longer, HasSubstr("--same-robot"));
  EXPECT_EQ(longer.find('\n'), longer.npos);
  EXPECT_THAT(RefusalOf(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/four_tendon_90mm.yaml")),
              HasSubstr("number of body.sections[0].tendons is 4 there, 3 in the file"));
  EXPECT_THAT(RefusalOf(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/two_section.yaml")),
              HasSubstr("number of body.sections is 2 there, 1 in the file"));
  RobotParameters one = rig_;
  one.actuation->tendons[1].drive.encoder_counts_per_turn = 4096;
  EXPECT_THAT(RefusalOf(one),
              HasSubstr("encoder_counts_per_turn (tendon 2) is 4096 there, 2048 in the file"));
  one = rig_;
  one.name = "sibling";
  EXPECT_THAT(RefusalOf(one), HasSubstr("name is sibling there, rig_60mm in the file"));
}

// A file changed by `gap apply`, and a finer model of the same backbone, still describe the same robot.
TEST_F(OtherRobotTest, ACorrectedFileIsAccepted) {
  EXPECT_THAT(LoadRunOf(rig_).notes, IsEmpty());
  RobotParameters other = rig_;
  other.body.sections[0].youngs_modulus_Pa *= 3;
  other.body.sections[0].unit_mass_kg *= 0.3;
  other.body.sections[0].tendons[0].radius_m *= 1.5;
  other.body.sections[0].units *= 2;
  other.body.sections[0].unit_length_m /= 2;
  other.actuation->tendons[0].motor.coulomb_friction_Nm *= 5;
  EXPECT_THAT(LoadRunOf(other).notes, IsEmpty());
  other = rig_;
  for (const double scale : {0.8, 1.2}) {
    other.effects = {{.name = "unit_length", .where = "all", .values = {{"scale", scale}}}};
    EXPECT_THAT(LoadRunOf(other).notes, Contains(HasSubstr("length"))) << scale;
  }
}

TEST_F(OtherRobotTest, NumbersOfGearSpoolAndDriveAreNoted) {
  for (auto& tendon : rig_.actuation->tendons) tendon.gear.ratio = 16;
  EXPECT_THAT(LoadRunOf(rig_).notes,
              Contains(HasSubstr("actuation.gear.ratio (tendon 1) is 16 there, 19 in the file")));
}

TEST_F(OtherRobotTest, IsNotedWhereTheUserSaysThatItIsTheSame) {
  rig_.name = "sibling";
  const DataSet set = LoadRunOf(rig_, OtherRobot::kNoted);
  EXPECT_EQ(set.runs.size(), 1U);
  EXPECT_THAT(set.notes, Contains(HasSubstr("name is sibling there, rig_60mm in the file")));
}

// An additional cell in a line, such as from an unquoted decimal comma, shifts the cells after it. As written
// by `tendril demo`: subfolders with the runs, of one robot or of several.
TEST_F(DataSetTest, AFolderOfFoldersStandsForThoseOfTheRobot) {
  const std::string other = TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml";
  const std::string table = "t_s,tension_N_1\n0,1\n0.001,3\n";
  Write("circle/a.csv", table);
  Write("planar/b.csv", table);
  fs::create_directories(folder_ / "empty");
  EXPECT_THAT(Load().runs, testing::SizeIs(2)) << "no folder says that it is of another robot";
  fs::copy_file(kRobot, folder_ / "circle/robot.yaml");
  fs::copy_file(other, folder_ / "planar/robot.yaml");
  const DataSet set = Load();
  ASSERT_THAT(set.runs, testing::SizeIs(1));
  EXPECT_EQ(set.runs[0].name, "a");
  EXPECT_THAT(set.notes,
              Contains(HasSubstr("planar is of robot 'rig_90mm', not 'rig_60mm', and is left out")));
  try {
    LoadDataSet(folder_, TENDRIL_SOURCE_DIR "/config/robots/four_tendon_90mm.yaml");
    FAIL() << "neither is its";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(),
                HasSubstr("circle is of robot 'rig_60mm', planar is of robot 'rig_90mm', the robot named "
                          "is 'four_tendon_90mm'; give the robot file"));
  }
}

TEST_F(DataSetTest, ADelimiterAtTheEndCountsOnlyWhereEveryLineHasOne) {
  EXPECT_THAT(Refusal("t_s,motor_position_rad_1\n0,1\n0.001,2,\n0.002,3\n"), HasSubstr("too many"));
  EXPECT_EQ(LoadTable("t_s,motor_position_rad_1\n0,1,\n0.001,2,\n0.002,3,\n").time_s.size(), 3);
}

TEST_F(DataSetTest, RunsFromBeforeAreOfTheSameRobot) {
  for (const char* file : {"then/hold.csv", "now/hold.csv"}) Write(file, kPlainTable);
  DataSet set = LoadDataSet(folder_ / "now", kRobot);
  DataSet then = LoadDataSet(folder_ / "then", kRobot);
  then.robot.body.sections[0].tendons.resize(2);
  EXPECT_THAT(
      [&] { CompareWithBefore(set, then); },
      testing::ThrowsMessage<std::runtime_error>(HasSubstr("with 2 tendons, these of 'rig_60mm' with 3")));
  then = LoadDataSet(folder_ / "then", kRobot);
  then.robot.body.sections[0].unit_mass_kg *= 2;
  CompareWithBefore(set, then);
  EXPECT_THAT(set.notes, Contains(HasSubstr("another robot file")));
}

}  // namespace
}  // namespace tendril::gap
