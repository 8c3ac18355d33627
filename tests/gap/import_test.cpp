// Tables of other programs through column maps: units, signs, frames and runs agree with a calculation by
// hand, and errors of a map are named. Tables of published robots are tested where available.
#include "tendril/gap/import.h"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "tendril/config/config.h"
#include "tendril/gap/health.h"

namespace tendril::gap {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

const std::string kSource = TENDRIL_SOURCE_DIR;
constexpr double kPi = std::numbers::pi;

class ImportTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("tendril_import_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    robot_ = config::LoadRobot(kSource + "/config/robots/rig_60mm.yaml");
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string Write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return (folder_ / name).string();
  }
  DataSet Import(const std::string& map, const std::string& table) const {
    return ImportTables(Write("map.yaml", map), {Write("table.csv", table)}, robot_);
  }
  std::string Refusal(const std::string& map, const std::string& table) const {
    try {
      Import(map, table);
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  }

  fs::path folder_;
  RobotParameters robot_;
};

TEST_F(ImportTest, UnitsSignsScalesAndOrderOfTendonsAreThoseOfTheMap) {
  const DataSet set = Import(
      "time: {column: ms, unit: ms}\n"
      "columns:\n"
      "  torque_target: {names: [c1, c2, c3], unit: A}\n"
      "  torque_actual: {names: [a1, a2, null], unit: mA, sign: [1, -1, 1]}\n"
      "  motor_position: {names: [d1, d2, d3], unit: mm}\n"
      "  tension: {names: [f1, f2, f3], unit: V, offset: [0.1, 0, 0], scale: 2}\n",
      "ms,c1,c2,c3,d1,d2,d3,f1,f2,f3,more,a1,a2\n1000,0.1,0.2,-0.3,1,2,-4,0.5,0.25,0,7,-0.3,0.1\n"
      "1010,,0.2,-0.3,1,2,-4,0.5,0.25,0,7,-0.3,0.1\n");
  const gap::Run& run = set.runs.at(0);
  EXPECT_EQ(run.name, "table");
  EXPECT_EQ(run.family, "unknown");
  EXPECT_EQ(run.load_cell, LoadCellPlace::kMotorSide);
  EXPECT_THAT(run.notes, Contains(HasSubstr("more")));
  EXPECT_TRUE(run.time_s.isApprox(Eigen::Vector2d(0, 0.01), 1e-12));
  const double kt = 0.0196, travel = 0.008 / 19;  // of the rig's data sheet
  EXPECT_TRUE(run.torque_target_Nm.row(0).isApprox(Eigen::RowVector3d(0.1, 0.2, -0.3) * kt, 1e-12));
  EXPECT_TRUE(std::isnan(run.torque_target_Nm(1, 0)));
  EXPECT_TRUE(
      run.torque_actual_Nm.row(0).head(2).isApprox(Eigen::RowVector2d(-0.3, -0.1) * kt * 1e-3, 1e-12));
  EXPECT_TRUE(run.torque_actual_Nm.col(2).array().isNaN().all());
  EXPECT_TRUE(run.motor_position_rad.row(0).isApprox(Eigen::RowVector3d(1, 2, -4) * 1e-3 / travel, 1e-12));
  EXPECT_TRUE(run.tension_N.row(0).isApprox(Eigen::RowVector3d(1.1, 0.5, 0) / 0.2, 1e-12));
}

TEST_F(ImportTest, AnglesOfMotorSpoolTurnsAndCountsAgree) {
  // A quarter turn of the spool is 4.75 turns of the motor in every unit.
  const double expected_rad = 4.75 * 2 * kPi;
  for (const auto& [unit, number] : {std::pair{"{unit: deg, at: spool,", "90"},
                                     {"{unit: rad, at: spool,", "1.5707963267948966"},
                                     {"{unit: turns, at: motor,", "4.75"},
                                     {"{unit: counts,", "9728"},
                                     {"{unit: deg,", "1710"}}) {
    const DataSet set =
        Import(fmt::format(
                   "time: {{rate_Hz: 10}}\ncolumns: {{motor_position: {} names: [null, a, null]}}}}\n", unit),
               fmt::format("a\n{0}\n{0}\n{0}\n", number));
    EXPECT_NEAR(set.runs.at(0).motor_position_rad(2, 1), expected_rad, 1e-9) << unit;
    EXPECT_NEAR(set.runs.at(0).time_s[2], 0.2, 1e-12);
  }
}

// One column cannot serve two channels, and tensions need the place of their load cell.
TEST_F(ImportTest, OneColumnIsOneSensors) {
  const auto refusal = [&](const std::string& map) -> std::string {
    try {
      Import("time: {column: t}\n" + map, "t,a,b,c,d\n0,1,2,3,4\n1,2,3,4,5\n");
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refusal("columns: {tip: {names: [a, a, b]}}\n"),
              HasSubstr("'a' stands for two numbers of tip"));
  EXPECT_THAT(refusal("columns: {torque_actual: {names: [a, b, c]}, tension: {names: [d, null, a]}}\n"),
              HasSubstr("'a' stands for torque_actual and tension"));
  EXPECT_THAT(refusal("columns: {tension: {names: [t, b, c]}}\n"),
              HasSubstr("'t' stands for time and tension"));
  EXPECT_THAT(refusal("runs: {load_cell: none}\ncolumns: {tension: {names: [a, b, c]}}\n"),
              HasSubstr("load_cell is none, and columns.tension names load cells"));
}

// The same pose in every notation of an orientation.
TEST_F(ImportTest, EveryOrientationIsTheSameRotation) {
  const Eigen::Matrix3d R =
      (Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.3, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(0.8, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  const Eigen::Quaterniond q(R);
  const Eigen::AngleAxisd turn(R);
  const Eigen::Vector3d v = turn.angle() * turn.axis();
  std::string matrix;
  for (int i = 0; i < 9; ++i) matrix += fmt::format(",{:.15g}", R(i / 3, i % 3));
  const std::string row =
      fmt::format("{:.15g},{:.15g},{:.15g},{:.15g},0.8,-0.3,0.4,{:.15g},{:.15g},{:.15g}{}\n", q.x(), q.y(),
                  q.z(), q.w(), v.x(), v.y(), v.z(), matrix);
  const std::string table = "x,y,z,w,roll,pitch,yaw,v1,v2,v3,r1,r2,r3,r4,r5,r6,r7,r8,r9\n" + row + row;
  for (const char* columns : {"{kind: quaternion, order: xyzw, names: [x, y, z, w]}", "{names: [w, x, y, z]}",
                              "{kind: euler, order: ZYX, names: [yaw, pitch, roll]}",
                              "{kind: euler, order: xyz, names: [roll, pitch, yaw]}",
                              "{kind: rotation_vector, names: [v1, v2, v3]}",
                              "{kind: matrix, names: [r1, r2, r3, r4, r5, r6, r7, r8, r9]}"}) {
    const DataSet set =
        Import(fmt::format("time: {{rate_Hz: 10}}\ncolumns: {{orientation: {}}}\n", columns), table);
    const Eigen::Vector4d got = set.runs.at(0).tip_quaternion.row(0);
    EXPECT_NEAR(std::abs(got.dot(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()))), 1, 1e-12) << columns;
  }
}

TEST_F(ImportTest, TheTrackersFrameBecomesTheBases) {
  // A trunk that hangs, seen by a camera whose y points up; the base is at (1, 2, 3).
  const std::string map =
      "time: {rate_Hz: 10}\n"
      "columns: {tip: {names: [x, y, z], unit: mm}, orientation: {names: [w, i, j, k]}}\n"
      "frame: {axes: [x, z, -y], offset_m: [-1, -3, 2]}\n";
  const double h = std::sqrt(0.5);
  // The tip's own axes at rest are the base's: its z down, its y the camera's z. As a rotation in the
  // camera's frame that is a quarter turn about x.
  const DataSet set =
      Import(map, fmt::format("x,y,z,w,i,j,k\n1000,1940,3000,{0},{0},0,0\n1010,1940,3020,{0},{0},0,0\n", h));
  const gap::Run& run = set.runs.at(0);
  EXPECT_TRUE(run.tip_m.row(0).isApprox(Eigen::RowVector3d(0, 0, 0.06), 1e-12)) << run.tip_m;
  EXPECT_TRUE(run.tip_m.row(1).isApprox(Eigen::RowVector3d(0.01, 0.02, 0.06), 1e-12)) << run.tip_m;
  EXPECT_NEAR(run.tip_quaternion(0, 0), 1, 1e-12) << run.tip_quaternion.row(0);
}

TEST_F(ImportTest, TheFirstRowsMayShowTheStraightRobot) {
  const DataSet set = Import(
      "time: {column: t}\ncolumns: {tip: {names: [x, y, z]}, orientation: {kind: euler, order: ZYX, unit: "
      "deg, names: [a, b, c]}}\n"
      "frame: {origin: rest}\n",
      "t,x,y,z,a,b,c\n0,5.001,-1,2,30,10,0\n0.1,4.999,-1,2,30,10,0\n0.6,5.01,-1,1.99,60,10,0\n");
  const gap::Run& run = set.runs.at(0);
  EXPECT_TRUE(run.tip_m.row(2).isApprox(Eigen::RowVector3d(0.01, 0, 0.05), 1e-9)) << run.tip_m;
  EXPECT_NEAR(run.tip_quaternion(0, 0), 1, 1e-12);
  // 30 deg further about the vertical, whatever the mount of the marker.
  EXPECT_NEAR(2 * std::acos(run.tip_quaternion(2, 0)), kPi / 6, 1e-9);
}

TEST_F(ImportTest, ATimeThatIsMissingAtFirstDoesNotMakeAllRowsRest) {
  const DataSet set = Import("time: {column: t}\ncolumns: {tip: {names: [x, y, z]}}\nframe: {origin: rest}\n",
                             "t,x,y,z\n,5,-1,2\n0,5,-1,2\n0.1,5,-1,2\n0.7,5.01,-1,1.99\n0.8,5.02,-1,1.99\n");
  const Eigen::MatrixXd& tip = set.runs.at(0).tip_m;
  EXPECT_TRUE(tip.row(tip.rows() - 1).isApprox(Eigen::RowVector3d(0.02, 0, 0.05), 1e-9)) << tip;
}

TEST_F(ImportTest, BendingMayBeAngleAndPlane) {
  const DataSet set =
      Import("time: {rate_Hz: 1}\ncolumns: {bending: {kind: angle_and_plane, unit: deg, names: [t, p]}}\n",
             "t,p\n60,30\n60,120\n");
  EXPECT_NEAR(set.runs.at(0).bending_rad(0, 0), kPi / 3 * std::cos(kPi / 6), 1e-12);
  EXPECT_NEAR(set.runs.at(0).bending_rad(1, 1), kPi / 3 * std::sin(2 * kPi / 3), 1e-12);
}

TEST_F(ImportTest, LabelsSplitATableIntoRunsFamiliesAndRepetitions) {
  const DataSet set = Import(
      "time: {column: t, unit: unix_s}\n"
      "runs:\n"
      "  by: {column: label, match: '(.*?)(_hold)?', as: '$1'}\n"
      "  family: {column: label, match: 'rep\\d+_([a-z]+).*', as: '$1'}\n"
      "  repeats: {column: label, match: 'rep\\d+_(.*?)(_hold)?', as: '$1'}\n"
      "  longest_gap_s: 10\n"
      "columns: {tension: {names: [f, null, null]}}\n",
      "t,label,f\n"
      "1778538600,rep1_circle,1\n1778538601,rep1_circle,2\n1778538602,rep1_circle_hold,3\n"
      "1778538603,rep1_pull 2,4\n1778538604,rep1_pull 2,5\n"
      "1778538605,rep2_circle,6\n1778538606,rep2_circle,7\n1778538607,lonely,0\n"
      "1778538608,odd,8\n1778538609,odd,9\n1778538700,odd,8\n1778538701,odd,9\n");
  ASSERT_EQ(set.runs.size(), 5u);
  EXPECT_EQ(set.runs[0].name, "table_rep1_circle");
  EXPECT_EQ(set.runs[0].time_s.size(), 3);
  EXPECT_EQ(set.runs[0].family, "circle");
  EXPECT_EQ(set.runs[0].repeat_of, "");
  EXPECT_EQ(set.runs[1].name, "table_rep1_pull_2");
  EXPECT_EQ(set.runs[1].family, "pull");
  EXPECT_EQ(set.runs[2].repeat_of, "table_rep1_circle");
  for (const gap::Run& run : set.runs) {  // a row a second, from 0 in each run
    for (Eigen::Index i = 0; i < run.time_s.size(); ++i)
      EXPECT_EQ(run.time_s[i], static_cast<double>(i)) << run.name;
  }
  EXPECT_EQ(set.runs[3].name, "table_odd");
  EXPECT_EQ(set.runs[4].name, "table_odd_2");  // after the hole
  EXPECT_EQ(set.runs[4].repeat_of, "table_odd");
  EXPECT_THAT(set.notes, Contains(HasSubstr("table_lonely left out: it has 1 usable row of")));
  // The result is an ordinary data set.
  WriteDataSet(set, folder_ / "set");
  const DataSet back = LoadDataSet(folder_ / "set", "");
  ASSERT_EQ(back.runs.size(), 5u);
  EXPECT_EQ(back.runs[2].repeat_of, "table_rep1_circle");
  EXPECT_EQ(back.runs[2].tension_N.col(0), set.runs[2].tension_N.col(0));
}

TEST_F(ImportTest, WrongMapsAreNamedWithTheirLineAndWhatIsAccepted) {
  const std::string table = "t,servo_1_mm,servo_2_mm,x\n0,1,2,3\n1,1,2,3\n";
  const auto expect = [&](const std::string& map, const std::string& text) {
    EXPECT_THAT(Refusal(map, table), HasSubstr(text));
  };
  const std::string good = "time: {column: t}\ncolumns:\n  tension: {names: [x, null, null]}\n";
  EXPECT_EQ(Refusal(good, table), "");
  expect(good + "colour: red\n",
         "map.yaml:4: colour: no such key; accepted: columns, frame, runs, table, time");
  expect("time: {column: t}\ncolumns:\n  tension: {names: [x, null, null], units: N}\n",
         "map.yaml:3: columns.tension.units: no such key");
  expect("time: {column: t, unit: hours}\ncolumns:\n  tension: {names: [x, null, null]}\n",
         "time.unit: 'hours' is not known; accepted: min, ms");
  expect("columns:\n  tension: {names: [x, null, null]}\n", "time: is missing");
  expect("time: {}\ncolumns:\n  tension: {names: [x, null, null]}\n", "neither");
  expect("time: {column: t}\ncolumns:\n  tension: {names: [x, x]}\n",
         "map.yaml:3: columns.tension.names: has 2 entries; accepted: a list of 3");
  expect("time: {column: t}\ncolumns:\n  tension: {names: [x, null, null], sign: 2}\n", "2 is not a sign");
  expect(good + "frame: {axes: [x, y, -z]}\n", "do not form a right-handed frame");
  expect(good + "runs: {by: {column: t, match: '(('}}\n", "is not a regular expression");
  expect("time: {column: t}\ncolumns:\n  tension: {names: [x, null, null], unit: lb}\n",
         "'lb' is not known; accepted: N, mN, kN, g, kg, V, mV");
  expect("time: [", "not YAML");
  expect("", "no column map");
  expect("time: {column: t}\ncolumns:\n  motor_position: {names: [servo_1_mm, servo_2mm, x], unit: mm}\n",
         "no column 'servo_2mm', which the map");
  expect("time: {column: t}\ncolumns:\n  motor_position: {names: [servo_1_mm, servo_2mm, x], unit: mm}\n",
         "did you mean 'servo_2_mm'?; there are: t, servo_1_mm, servo_2_mm, x");
}

TEST_F(ImportTest, MarkersOnDisksAreInTheBaseFrameLikeTheTip) {
  const DataSet set = Import(
      "time: {column: t}\n"
      "columns:\n"
      "  motor_position: {names: [a, b, c], unit: deg}\n"
      "  disks: {unit: mm, 1: [x1, y1, z1], 3: [x3, y3, z3]}\n"
      "frame: {axes: [x, z, -y], offset_m: [0, 0, 0.1]}\n",
      "t,a,b,c,x1,y1,z1,x3,y3,z3\n0,1,2,3,4,5,6,7,8,9\n1,1,2,3,4,5,6,7,,9\n");
  const Eigen::MatrixXd& disks = set.runs.at(0).disks_m;
  ASSERT_EQ(disks.cols(), 3 * robot_.body.disks());
  EXPECT_TRUE(disks.row(0).segment<3>(0).isApprox(Eigen::RowVector3d(0.004, 0.006, 0.095), 1e-12));
  EXPECT_TRUE(disks.row(0).segment<3>(6).isApprox(Eigen::RowVector3d(0.007, 0.009, 0.092), 1e-12));
  EXPECT_TRUE(disks.middleCols(3, 3).array().isNaN().all());
  EXPECT_TRUE(std::isnan(disks(1, 6 + 2)));  // of a reading that the table lacks
  const std::string map = "time: {column: t}\ncolumns: {disks: ";
  EXPECT_THAT(Refusal(map + "{9: [x, y, z]}}\n", "t,x,y,z\n0,1,2,3\n"), HasSubstr("columns.disks"));
  EXPECT_THAT(Refusal(map + "{1: [x, y]}}\n", "t,x,y,z\n0,1,2,3\n"), HasSubstr("columns.disks.1"));
  EXPECT_THAT(Refusal(map + "{unit: mm}}\n", "t,x,y,z\n0,1,2,3\n"), HasSubstr("names no disk"));
  EXPECT_THAT(Refusal(map + "{1: [x, y, z]}}\nframe: {origin: rest}\n", "t,x,y,z\n0,1,2,3\n"),
              HasSubstr("frame.origin"));
}

TEST_F(ImportTest, DisksMayHaveOrientations) {
  const std::string columns = "time: {column: t}\ncolumns:\n  motor_position: {names: [a, b, c]}\n";
  const DataSet set =
      Import(columns + "  disk_orientations: {order: xyzw, 1: [x1, y1, z1, w1], 3: [x3, y3, z3, w3]}\n" +
                 "frame: {axes: [x, z, -y]}\n",
             "t,a,b,c,x1,y1,z1,w1,x3,y3,z3,w3\n0,1,2,3,0,0,0,1,0,0,1,0\n1,1,2,3,0,0,0,2,0,0,,1\n");
  const gap::Run& run = set.runs.at(0);
  ASSERT_EQ(run.disk_quaternion.cols(), 4 * robot_.body.disks());
  const double half = std::sqrt(0.5);  // the table's frame lies turned by -90 deg about x
  EXPECT_TRUE(
      run.disk_quaternion.row(0).segment<4>(0).isApprox(Eigen::RowVector4d(half, -half, 0, 0), 1e-12));
  EXPECT_TRUE(run.disk_quaternion.row(0).segment<4>(8).isApprox(Eigen::RowVector4d(0, 0, half, half), 1e-12))
      << run.disk_quaternion.row(0);
  EXPECT_TRUE(run.disk_quaternion.row(0).segment<4>(4).array().isNaN().all());
  EXPECT_TRUE(run.disk_quaternion.row(1).array().isNaN().all());  // not of unit length; a reading that lacks
  ASSERT_EQ(run.warnings.size(), 1u);
  EXPECT_THAT(run.warnings.front(), HasSubstr("1 orientation is no rotation"));

  // At rest the sensors show how they are mounted.
  const gap::Run rest =
      Import(columns + "  disk_orientations: {kind: euler, order: zyx, unit: deg, 2: [r, p, y]}\n" +
                 "frame: {origin: rest}\n",
             "t,a,b,c,r,p,y\n0,1,2,3,90,0,0\n1,1,2,3,90,0,10\n")
          .runs.at(0);
  EXPECT_TRUE(rest.disk_quaternion.row(0).segment<4>(4).isApprox(Eigen::RowVector4d(1, 0, 0, 0), 1e-12));
  const double five = 5 * std::numbers::pi / 180;
  EXPECT_NEAR(rest.disk_quaternion(1, 4), std::cos(five), 1e-12);

  const std::string map = "time: {column: t}\ncolumns: {disk_orientations: ";
  EXPECT_THAT(Refusal(map + "{9: [w, x, y, z]}}\n", "t,w,x,y,z\n0,1,0,0,0\n"),
              HasSubstr("columns.disk_orientations"));
  EXPECT_THAT(Refusal(map + "{1: [w, x, y]}}\n", "t,w,x,y,z\n0,1,0,0,0\n"),
              HasSubstr("columns.disk_orientations.1"));
  EXPECT_THAT(Refusal(map + "{kind: euler, 1: [x, y, z]}}\n", "t,w,x,y,z\n0,1,0,0,0\n"),
              HasSubstr("columns.disk_orientations.order"));
  EXPECT_THAT(Refusal(map + "{order: wxyz}}\n", "t,w,x,y,z\n0,1,0,0,0\n"), HasSubstr("names no disk"));
  EXPECT_THAT(Refusal(map + "{1: [w, x, y, z], 2: [w, x, y, z]}}\n", "t,w,x,y,z\n0,1,0,0,0\n1,1,0,0,0\n"),
              HasSubstr("'w' stands for two numbers of disk_orientations"));
}

TEST_F(ImportTest, MillimetresTakenForMetresAreNoticed) {
  std::string table = "t,x,y,z\n";
  for (int i = 0; i < 200; ++i)
    table += fmt::format("{},{},{},{}\n", 0.01 * i, 10 * std::sin(0.1 * i), 3.0, 58.5);
  const std::string map = "time: {column: t}\ncolumns: {tip: {names: [x, y, z], unit: ";
  std::string wrong, right;
  for (const HealthFinding& f : CheckHealth(Import(map + "m}}\n", table))) wrong += f.text + "\n";
  for (const HealthFinding& f : CheckHealth(Import(map + "mm}}\n", table))) right += f.text + "\n";
  EXPECT_THAT(wrong, HasSubstr("these are millimetres"));
  EXPECT_THAT(right, Not(HasSubstr("millimetres")));
}

TEST_F(ImportTest, NoBytesCrashMapOrTable) {
  std::ifstream in(kSource + "/config/import/every_key_map.yaml");
  const std::string map((std::istreambuf_iterator<char>(in)), {});
  const std::string table =
      "timestamp,label,i_cmd_1,i_cmd_2,i_cmd_3,i_1,i_2,i_3,enc_1,enc_2,enc_3,cell_1,cell_3,X,Y,Z,X1,Y1,Z1,qx,"
      "qy,qz,qw,theta,phi,yaw1,pitch1,roll1\n"
      "1,rep1_a,1,2,3,4,5,6,7,8,9,1,2,0,0,60,0,0,15,0,0,0,1,1,2,0,1,2\n"
      "2,rep1_a,1,2,3,4,5,6,7,8,9,1,2,0,0,60,0,0,15,0,0,0,1,1,2,0,1,2\n"
      "3,rep1_b,1,2,3,4,5,6,7,8,9,1,2,0,0,60,0,0,15,0,0,0,1,1,2,0,1,2\n"
      "4,rep1_b,1,2,3,4,5,6,7,8,9,1,2,0,0,60,0,0,15,0,0,0,1,1,2,0,1,2\n";
  ASSERT_EQ(Refusal(map, table), "");
  std::mt19937 random(3);
  const auto mutate = [&](std::string text) {
    for (int n = static_cast<int>(random() % 3) + 1; n > 0 && !text.empty(); --n) {
      const std::size_t at = random() % text.size();
      switch (random() % 4) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text.erase(at, random() % 30);
          break;
        case 2:
          text.insert(at, text.substr(random() % text.size(), random() % 30));
          break;
        default:
          text[at] = ",;\n:[]{}'\"0"[random() % 11];
          break;
      }
    }
    return text;
  };
  int imported = 0;
  for (int i = 0; i < 300; ++i) {
    try {
      const DataSet set = Import(i % 2 ? mutate(map) : map, i % 2 ? table : mutate(table));
      CheckHealth(set);
      ++imported;
    } catch (const std::exception& e) {
      ASSERT_THAT(std::string(e.what()), Not(IsEmpty()));
    }
  }
  EXPECT_GT(imported, 30);
}

// The shipped maps and robot files fit together; where the published tables are available, they are imported.
class PublishedTest : public testing::Test {
 protected:
  static std::string Folder() {
    const char* given = std::getenv("TENDRIL_REAL_DATA");
    return given != nullptr ? given : kSource + "/../shared/real";
  }
  static RobotParameters Robot(const std::string& name) {
    return config::LoadRobot(kSource + "/config/import/" + name + ".yaml");
  }
  static DataSet Import(const std::string& name, const std::vector<std::string>& tables) {
    std::vector<std::string> paths;
    for (const std::string& table : tables) paths.push_back(Folder() + "/" + table);
    return ImportTables(kSource + "/config/import/" + name + "_map.yaml", paths, Robot(name));
  }
};

TEST_F(PublishedTest, ThreeSectionsQuasiStatic) {
  if (!fs::exists(Folder() + "/opencr_tdcr"))
    GTEST_SKIP() << "no tables in " << Folder() << "; TENDRIL_REAL_DATA names their folder";
  const DataSet v4 = Import("opencr_tdcr_v4", {"opencr_tdcr/v4_tendon_pull.csv"});
  // Nine tendons, one pull each: the tip moves towards the pulled tendon's angle in the robot file; sections
  // are rotated by 30 deg against each other.
  int pulls = 0;
  for (const gap::Run& run : v4.runs) {
    EXPECT_EQ(run.family, "tendon_pull");
    Eigen::Index j = 0, most = 0;
    run.motor_position_rad.colwise().maxCoeff().maxCoeff(&j);
    run.motor_position_rad.col(j).maxCoeff(&most);
    const TendonRoute& route =
        v4.robot.body.sections[static_cast<std::size_t>(j / 3)].tendons[static_cast<std::size_t>(j % 3)];
    const Eigen::Index rest = run.time_s.size() - 1;
    const Eigen::Vector2d moved = (run.tip_m.row(most) - run.tip_m.row(rest)).head(2).transpose();
    if (moved.norm() < 0.01) continue;
    ++pulls;
    EXPECT_GT(moved.normalized().dot(Eigen::Vector2d(std::cos(route.angle_rad), std::sin(route.angle_rad))),
              0.9)
        << run.name;
    EXPECT_LT(run.tip_m.rowwise().norm().maxCoeff(), 0.2);
  }
  EXPECT_GE(pulls, 8);
  const DataSet all = Import("opencr_tdcr_v4", {"opencr_tdcr/v4_train.csv", "opencr_tdcr/v4_val.csv"});
  Eigen::Index rows = 0;
  for (const gap::Run& run : all.runs) rows += run.time_s.size();
  EXPECT_GT(rows, 2000);
  const DataSet v6 = Import("opencr_tdcr_v6", {"opencr_tdcr/v6_train.csv", "opencr_tdcr/v6_val.csv"});
  EXPECT_GT(v6.runs.size(), 50u);
}

TEST_F(PublishedTest, ATrunkWithPairsOfTendons) {
  if (!fs::exists(Folder() + "/trunk_payload"))
    GTEST_SKIP() << "no tables in " << Folder() << "; TENDRIL_REAL_DATA names their folder";
  const DataSet set = Import("trunk_payload", {"trunk_payload/nominal.csv", "trunk_payload/a.csv"});
  ASSERT_EQ(set.runs.size(), 2u);
  const gap::Run& run = set.runs[0];
  EXPECT_EQ(run.time_s.size(), 15001);
  EXPECT_NEAR(run.time_s[15000], 150, 1e-9);
  EXPECT_EQ(run.motor_position_rad.cols(), 12);
  EXPECT_EQ(run.motor_position_rad.col(0), -run.motor_position_rad.col(2));
  // It hangs along +z of its base and is about as long as its file says.
  EXPECT_NEAR(run.tip_m.col(2).maxCoeff(), set.robot.body.length_m(), 0.03);
  // At rest its first two disks are where the file's sections end.
  EXPECT_NEAR(run.disks_m(0, 3 * 2 + 2), 0.105, 0.005);
  EXPECT_NEAR(run.disks_m(0, 3 * 5 + 2), 0.199, 0.005);
}

TEST_F(ImportTest, DecimalCommasInQuotesAreReadWhereTheMapSaysSo) {
  const std::string columns = "columns: {tip: {names: [x, y, z]}}\n";
  const std::string table = "\"x\",\"y\",\"z\"\n\"0,0015\",\"-2\",\"1e-3\"\n\"0,5\",\"2,5\",\"\"\n";
  const gap::Run run = Import("table: {decimal: comma}\ntime: {rate_Hz: 100}\n" + columns, table).runs.at(0);
  EXPECT_TRUE(run.tip_m.row(0).isApprox(Eigen::RowVector3d(0.0015, -2, 1e-3), 1e-15));
  EXPECT_EQ(Refusal("table: {delimiter: comma, decimal: comma}\ntime: {rate_Hz: 100}\n" + columns, table),
            "");
  EXPECT_THAT(Refusal("time: {rate_Hz: 100}\n" + columns, table),
              HasSubstr("if its comma is a decimal one, set table: {decimal: comma}"));
  EXPECT_THAT(Refusal("table: {decimal: comma}\ntime: {rate_Hz: 100}\n" + columns, "x,y,z\n0,1,0,2,0,3\n"),
              HasSubstr("numbers with a decimal comma need quotes"));
}

TEST_F(ImportTest, AColumnIsOneTendons) {
  EXPECT_THAT(
      Refusal("time: {rate_Hz: 100}\ncolumns:\n  tension: {names: [a, b, a]}\n", "a,b\n1,2\n3,4\n"),
      HasSubstr(":3: columns.tension.names: 'a' stands for two tendons; accepted: a column of its own"));
}

}  // namespace
}  // namespace tendril::gap
