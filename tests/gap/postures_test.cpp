// A robot whose motors hold positions: learned from its postures, and what changed named from those after.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <numbers>
#include <numeric>
#include <random>

#include "gap/implausible.h"
#include "gap/pair_motors.h"
#include "gap/postures/diagnose_postures.h"
#include "gap/postures/directions.h"
#include "gap/postures/learn_postures.h"
#include "gap/postures/motor_path.h"
#include "gap/postures/posterior.h"
#include "gap/rotation.h"
#include "gap/sources.h"
#include "support/hose.h"
#include "tendril/config/config.h"
#include "tendril/gap/calibrate.h"
#include "tendril/gap/cuts.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/run_table.h"
#include "tendril/robot_file/robot_patch.h"
#include "tendril/sim/batch.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {
namespace {

/// A hanging hose of two sections with four tendons each, 0.2 m long.
RobotParameters Hose() {
  RobotParameters robot;
  robot.name = "hose";
  robot.body.gravity_W_mps2 = {0, 0, 9.81};
  for (int k = 0; k < 2; ++k) {
    robot.body.sections.push_back(HoseSection(2, 0.05, k * std::numbers::pi / 4));
    const std::string key = "body.sections[" + std::to_string(k + 1) + "].youngs_modulus_Pa";
    robot.uncertain[key] = {Uncertainty::Kind::kUnknown, 0};
  }
  robot.limits.min_tension_N = 4;
  robot.limits.max_tension_base_N = robot.limits.max_tension_motor_N = 60;
  robot.limits.max_bending_rad = 2;
  TendonDriveParameters drive;
  drive.motor.torque_constant_NmpA = drive.motor.nominal_current_A = 1;
  drive.motor.rotor_inertia_kgm2 = 1e-4;
  drive.drive.encoder_counts_per_turn = 4096;
  drive.drive.rated_torque_Nm = drive.drive.current_limit_A = 1;
  drive.gear.ratio = drive.gear.efficiency = 1;
  drive.gear.presliding_yields_rad = {0.005};
  drive.motor.coulomb_friction_Nm = drive.motor.coulomb_angle_rad = 0.01;
  drive.motor.coulomb_damping_Nms = 1e-6;
  drive.transmission.presliding_m = 5e-5;
  drive.tendon.damping_Nspm = 10;
  drive.tendon.free_length_m = 0.2;
  drive.spool.radius_m = 0.01;
  drive.tendon.stiffness_Npm = 800;
  robot.actuation.emplace();
  for (drive.node_id = 1; drive.node_id <= 8; ++drive.node_id) robot.actuation->tendons.push_back(drive);
  robot.uncertain["actuation.tendon.stiffness_Npm"] = {Uncertainty::Kind::kUnknown, 0};
  return robot;
}

/// What the file says, wrong as much as it admits.
RobotParameters AsBuilt() {
  RobotParameters robot = Hose();
  robot.body.sections[0].youngs_modulus_Pa *= 1.6;
  robot.body.sections[1].youngs_modulus_Pa *= 0.7;
  robot.body.sections[0].unit_mass_kg *= 1.2;
  robot.body.sections[1].tendons[2].angle_rad += 0.03;
  robot.body.sections[0].tendons[1].radius_m *= 1.05;
  for (auto& drive : robot.actuation->tendons) drive.tendon.stiffness_Npm *= 1.5;
  return robot;
}

/// Slow motion of all motors, opposite tendons against each other, with errors of a tracker of 0.2 mm and of
/// a model that is off by 0.2 mm an axis, which changes slowly.
Run Moved(const RobotParameters& robot, const std::string& name, unsigned seed, double duration_s = 120) {
  constexpr double kRate_Hz = 20;
  const auto rows = static_cast<Eigen::Index>(duration_s * kRate_Hz);
  Run run;
  run.name = name;
  run.family = "slow";
  run.time_s = Eigen::VectorXd::LinSpaced(rows, 0, static_cast<double>(rows - 1) / kRate_Hz);
  run.motor_position_rad.resize(rows, 8);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.05, 0.25);
  for (int j = 0; j < 8; ++j) {
    const int pair = 4 * (j / 4) + j % 2;
    std::mt19937 of_pair(seed * 100 + static_cast<unsigned>(pair));
    const double f1 = uniform(of_pair), f2 = uniform(of_pair), sign = j % 4 < 2 ? 1 : -1;
    run.motor_position_rad.col(j) = sign * (0.7 * (2 * std::numbers::pi * f1 * run.time_s.array()).sin() +
                                            0.5 * (2 * std::numbers::pi * f2 * run.time_s.array()).sin());
  }
  States states{name, run.time_s, run.motor_position_rad, {}, {}, 0};
  const Postures postures{{{false, 1}, {false, 3}}, robot.body.length_m(), {states}};
  const Predicted at =
      Predict([&](const Eigen::VectorXd&) { return PostureRobot::Of(robot); }, {}, 0, postures, 2);
  EXPECT_EQ(at.unsolved, 0);
  run.disks_m = Eigen::MatrixXd::Constant(rows, 12, kNoReading);
  Eigen::RowVectorXd slow = Eigen::RowVectorXd::Zero(6);
  for (Eigen::Index i = 0; i < rows; ++i) {
    for (int c = 0; c < 6; ++c) slow[c] = 0.97 * slow[c] + 0.24 * 2e-4 * normal(random);
    for (int c = 0; c < 6; ++c) {
      const Eigen::Index column = (c < 3 ? 3 : 9) + c % 3;
      run.disks_m(i, column) = at.channels_m(i, c) + slow[c] + 2e-4 * normal(random);
    }
  }
  return run;
}

/// The same with orientation sensors on disks 2 and 4 instead of markers, mounted askew, with errors of 3
/// mrad.
Run Turned(const RobotParameters& robot, const std::string& name, unsigned seed) {
  const Eigen::Quaterniond mount(Rotation({0.05, -0.1, 0.2}));
  Run run = Moved(robot, name, seed);
  const Eigen::Index rows = run.time_s.size();
  States states{name, run.time_s, run.motor_position_rad, {}, {}, 0};
  states.quaternion = Eigen::RowVector<double, 8>(1, 0, 0, 0, 1, 0, 0, 0).replicate(rows, 1);
  const Predicted at = Predict([&](const Eigen::VectorXd&) { return PostureRobot::Of(robot); }, {}, 0,
                               {{{true, 1}, {true, 3}}, 1, {states}}, 2);
  run.disks_m.resize(0, 0);
  run.disk_quaternion = Eigen::MatrixXd::Constant(rows, 16, kNoReading);
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 3e-3);
  for (Eigen::Index i = 0; i < rows; ++i) {
    for (const Eigen::Index sensor : {0, 1}) {
      const Eigen::Vector3d turn = at.channels_m.row(i).segment<3>(3 * sensor);
      const Eigen::Vector3d error(noise(random), noise(random), noise(random));
      Eigen::Quaterniond q = Eigen::Quaterniond(Rotation(turn)) * mount * Eigen::Quaterniond(Rotation(error));
      if (i % 2 == 1) q.coeffs() *= -1;  // the same rotation
      run.disk_quaternion.row(i).segment<4>(8 * sensor + 4) << q.w(), q.x(), q.y(), q.z();
    }
  }
  return run;
}

using Recorded = Run (*)(const RobotParameters& robot, const std::string& name, unsigned seed);
Run Marked(const RobotParameters& robot, const std::string& name, unsigned seed) {
  return Moved(robot, name, seed);
}

DataSet Compared(const RobotParameters& before, const RobotParameters& after, Recorded recorded = Marked) {
  DataSet set{"after", Hose(), false, {recorded(after, "after", 2)}, {}};
  CompareWithBefore(set, {"before", Hose(), false, {recorded(before, "before", 1)}, {}});
  return set;
}

Diagnosis Diagnosed(const RobotParameters& after, Recorded recorded = Marked) {
  const DataSet set = Compared(AsBuilt(), after, recorded);
  EXPECT_TRUE(CanDiagnosePostures(set));
  DiagnoseOptions options;
  options.threads = 2;
  options.refits = 4;
  return Diagnose(set, options);
}

TEST(Postures, NumbersThatNobodyKnewAreLearned) {
  const gap::Run run = Moved(AsBuilt(), "run", 1);
  const LearnedPostures learned = LearnPostures(Hose(), PosturesOf({&run}, Hose()), true, {.threads = 2});
  EXPECT_TRUE(learned.converged);

  EXPECT_LT(PointRms(learned.held_out_m, 1), 1.2e-3);
  EXPECT_GT(PointRms(learned.as_filed_m, 1), 2 * PointRms(learned.held_out_m, 1));
  const Eigen::MatrixXd covariance = learned.precision.inverse();
  for (std::size_t k = 0; k < learned.numbers.size(); ++k) {
    const PostureNumber& number = learned.numbers[k];
    const auto i = static_cast<Eigen::Index>(k);
    if (number.key == "wrap of the sheaths") {
      EXPECT_LT(std::abs(1 + learned.x[i]), 0.1) << number.key;  // there is none
    }
    if (!number.value || number.assumed) continue;
    const double is = number.value(AsBuilt()), file = number.value(Hose());
    const double truth = number.additive ? is - file : std::log(is / file);
    EXPECT_LT(std::abs(learned.x[i] - truth), 4 * std::sqrt(covariance(i, i))) << number.key;
  }
}

/// With sheaths from spools to base, bent by this, that the file does not draw.
RobotParameters InSheaths(double wrap_rad) {
  RobotParameters robot = WithSheaths(AsBuilt());
  for (TendonDriveParameters& drive : robot.actuation->tendons)
    drive.transmission.pulleys.front().wrap_rad = wrap_rad;
  return robot;
}

TEST(Postures, FrictionIsLearnedWhereNoPulleysAreDrawn) {
  constexpr double kWrap_rad = 2.5;
  const gap::Run run = Moved(InSheaths(kWrap_rad), "run", 1);
  const LearnedPostures learned = LearnPostures(Hose(), PosturesOf({&run}, Hose()), true, {.threads = 2});
  EXPECT_LT(PointRms(learned.held_out_m, 1), 1.2e-3);
  const Eigen::MatrixXd covariance = learned.precision.inverse();
  const auto common = std::find_if(learned.numbers.begin(), learned.numbers.end(),
                                   [](const auto& number) { return number.key == "wrap of the sheaths"; });
  ASSERT_NE(common, learned.numbers.end());
  const Eigen::Index i = common - learned.numbers.begin();
  const double usual_wrap = WithSheaths(Hose()).actuation->tendons[0].transmission.pulleys[0].wrap_rad;
  const double share = 1 + learned.x[i];
  EXPECT_LT(std::abs(share - kWrap_rad / usual_wrap), 4 * std::sqrt(covariance(i, i)));
  EXPECT_LT(std::sqrt(covariance(i, i)), 0.2 * share);
}

class BentSheath : public testing::TestWithParam<double> {};

/// Before: as wide as is usual, or a path without friction.
INSTANTIATE_TEST_SUITE_P(Postures, BentSheath, testing::Values(0.7, 0));

TEST_P(BentSheath, IsNamed) {
  RobotParameters after = InSheaths(GetParam());
  after.actuation->tendons[2].transmission.pulleys[0].wrap_rad += 3;
  const DataSet set = Compared(InSheaths(GetParam()), after);
  DiagnoseOptions options;
  options.threads = 2;
  options.refits = 4;
  const Diagnosis d = Diagnose(set, options);
  double of_friction = 0;
  for (const Cause& cause : d.causes) {
    // A path with one bend has twice the friction by twice the angle or twice the coefficient.
    const bool friction = cause.effect == "wrap_angle" || cause.effect == "capstan_alpha";
    if (!friction || cause.where != "tendon:3") continue;
    of_friction += cause.p;
    if (cause.effect != "wrap_angle") continue;
    const Estimate wrap = cause.parameters.at("extra_rad");
    EXPECT_LT(wrap.low, 3);
    EXPECT_GT(wrap.high, 3);
  }
  EXPECT_GT(of_friction, 0.9) << d.sentence;
}

TEST(Postures, TendonsSlideAsTheirMotorsTurnedLast) {
  gap::Run run;
  run.time_s = Eigen::VectorXd::LinSpaced(8, 0, 3.5);
  run.motor_position_rad.resize(8, 1);
  run.motor_position_rad << 0, 0.1, 0.2, 0.1, kNoReading, 0.1, 0.1001, 0.3;
  States states{"run", run.time_s, run.motor_position_rad, {}, {}, 0};
  states.path_rad = run.motor_position_rad;
  states.path_rad(4, 0) = 0.1;
  states.rows = {{0, 1}, {1, 2}, {3, 1}, {5, 2}, {7, 1}};
  states.time_s = Eigen::VectorXd::LinSpaced(5, 0, 3.5);
  const Eigen::VectorXd travel_m = Eigen::VectorXd::Constant(1, 0.01);
  const Eigen::MatrixXd z = SlidingOf(states, travel_m, Eigen::VectorXd::Constant(1, 1e-4));
  EXPECT_EQ(z(0, 0), 0);
  EXPECT_EQ(z(1, 0), 1);
  EXPECT_EQ(z(2, 0), -1);
  EXPECT_NEAR(z(3, 0), -1, 0.02);  // a step of a hundredth of the pre-sliding
  EXPECT_EQ(z(4, 0), 1);
}

// The simulator finds the same equilibria its own way.
TEST(Postures, AreThoseOfTheSimulatorAtRest) {
  const RobotParameters robot = AsBuilt();
  const gap::Run run = Moved(robot, "run", 4, 10);
  const Postures postures = PosturesOf({&run}, robot);
  const Predicted at =
      Predict([&](const Eigen::VectorXd&) { return PostureRobot::Of(robot); }, {}, 0, postures, 1);
  const States& states = postures.runs.front();
  sim::ReplaySignals signals;
  signals.at_rest = true;
  signals.step_s = 0.25;
  signals.load_cell = LoadCellPlace::kNone;
  signals.motor_angle_rad = states.motor_rad;
  signals.motor_velocity_radps = signals.motor_acceleration_radps2 =
      Eigen::MatrixXd::Zero(states.motor_rad.rows(), 8);
  const sim::BodyMotion motion = sim::Replay(robot).Body(signals, sim::Replay::DrivenBy::kMotor);
  ASSERT_EQ(motion.tip_m.rows(), at.channels_m.rows());
  EXPECT_LT((motion.tip_m - at.channels_m.rightCols(3)).rowwise().norm().maxCoeff(), 3e-4);
  EXPECT_GT(motion.tip_m.col(0).maxCoeff() - motion.tip_m.col(0).minCoeff(), 0.02);
}

// ... and what friction does to them on the way is what it does there, apart from inertia and damping.
TEST(Postures, FrictionIsThatOfTheSimulatorInSlowMotion) {
  const RobotParameters robot = InSheaths(2);
  RobotParameters smooth = robot;
  for (auto& drive : smooth.actuation->tendons) drive.transmission.pulleys.front().alpha = 0;
  const gap::Run run = Moved(robot, "run", 4, 30);
  const Postures postures = PosturesOf({&run}, robot);
  sim::ReplaySignals signals;
  signals.step_s = 0.05;
  signals.load_cell = LoadCellPlace::kNone;
  signals.motor_angle_rad = run.motor_position_rad;
  const Eigen::Index rows = signals.motor_angle_rad.rows();
  signals.motor_velocity_radps = signals.motor_acceleration_radps2 = Eigen::MatrixXd::Zero(rows, 8);
  for (Eigen::Index i = 1; i + 1 < rows; ++i) {
    signals.motor_velocity_radps.row(i) =
        (signals.motor_angle_rad.row(i + 1) - signals.motor_angle_rad.row(i - 1)) / (2 * signals.step_s);
  }
  const auto simulated = [&](const RobotParameters& of) {
    const Eigen::MatrixXd tip_m = sim::Replay(of).Body(signals, sim::Replay::DrivenBy::kMotor).tip_m;
    EXPECT_EQ(tip_m.rows(), rows);
    Eigen::MatrixXd means(postures.states(), 3);
    for (Eigen::Index s = 0; s < means.rows(); ++s) {
      const States::Rows its = postures.runs[0].rows[static_cast<std::size_t>(s)];
      means.row(s) = tip_m.middleRows(its.first, its.count).colwise().mean();
    }
    return means;
  };
  const auto predicted = [&](const RobotParameters& of) {
    const Predicted at =
        Predict([&](const Eigen::VectorXd&) { return PostureRobot::Of(of); }, {}, 0, postures, 1);
    return Eigen::MatrixXd(at.channels_m.rightCols(3));
  };
  // Statics have one pull in which friction turns round, that which the tendon stretches meanwhile included.
  RobotParameters stretched = robot;
  for (auto& drive : stretched.actuation->tendons) drive.transmission.presliding_m *= 4;
  const Eigen::MatrixXd by_friction = simulated(robot) - simulated(smooth);
  EXPECT_LT((predicted(stretched) - predicted(smooth) - by_friction).norm(), 0.25 * by_friction.norm());
}

TEST(Postures, SlopesAreThoseOfThePrediction) {
  const RobotParameters robot = WithSheaths(Hose());
  gap::Run run = Moved(robot, "run", 3, 5);
  run.disk_quaternion = Eigen::MatrixXd::Constant(run.time_s.size(), 16, kNoReading);
  run.disk_quaternion.middleCols(4, 4) =
      Eigen::RowVector4d(1, 0.1, -0.2, 0.1).normalized().replicate(run.time_s.size(), 1);
  const Postures postures = PosturesOf({&run}, robot);
  ASSERT_EQ(postures.points, (std::vector<PosturePoint>{{false, 1}, {false, 3}, {true, 1}}));
  const std::vector<PostureNumber> numbers = PostureNumbers(robot, true, postures.points);
  const PostureRobot file = PostureRobot::Of(robot);
  const RobotAt at = [&](const Eigen::VectorXd& x) { return WithNumbers(file, numbers, x); };
  const auto n = static_cast<int>(numbers.size());
  const Predicted here = Predict(at, Eigen::VectorXd::Zero(n), n, postures, 1);
  for (int k = 0; k < n; ++k) {
    Eigen::VectorXd ahead = Eigen::VectorXd::Zero(n), behind = ahead;
    ahead[k] = 2e-4;
    behind[k] = -2e-4;
    const Eigen::MatrixXd slope =
        (Predict(at, ahead, 0, postures, 1).channels_m - Predict(at, behind, 0, postures, 1).channels_m) /
        4e-4;
    const auto& found = here.slopes[static_cast<std::size_t>(k)];
    EXPECT_LT((slope - found).norm(), 0.01 * slope.norm() + 1e-6) << numbers[static_cast<std::size_t>(k)].key;
  }
}

/// With a motor for every two opposite tendons.
RobotParameters InPairs(RobotParameters robot) {
  for (const int first : {0, 1, 4, 5}) robot.actuation->pairs.push_back({first, first + 2, 5});
  return robot;
}

/// As such a robot is recorded: a position a motor.
Run OfMotors(const RobotParameters& robot, Run run) {
  for (const TendonPair& pair : robot.actuation->pairs)
    run.motor_position_rad.col(pair.second).setConstant(kNoReading);
  CompletePairs(robot, run);
  return run;
}

// A coupling that slipped turns the spools of both tendons, a payload neither.
TEST(Postures, OfAntagonisticPairsAreDiagnosedFromAPositionAMotor) {
  const RobotParameters file = InPairs(Hose()), before = InPairs(AsBuilt());
  RobotParameters heavy = before, slipped = before;
  heavy.body.tip_payload_kg = 0.2;
  slipped.effects.push_back({"encoder_offset", "tendon:2", {{"rad", 0.3}}});
  for (const RobotParameters& after : {heavy, slipped}) {
    DataSet set{"after", file, false, {OfMotors(after, Moved(after, "after", 2))}, {}};
    CompareWithBefore(set, {"before", file, false, {OfMotors(before, Moved(before, "before", 1))}, {}});
    ASSERT_TRUE(CanDiagnosePostures(set));
    DiagnoseOptions options;
    options.threads = 2;
    options.refits = 4;
    const Diagnosis d = Diagnose(set, options);
    EXPECT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
    ASSERT_FALSE(d.accepted.empty()) << d.sentence;
    const Cause& cause = d.accepted.front();
    EXPECT_GT(cause.p, 0.9) << d.sentence;
    if (after.effects.empty()) {
      EXPECT_EQ(cause.effect, "tip_payload");
      EXPECT_LT(cause.parameters.at("mass_kg").low, 0.2);
      EXPECT_GT(cause.parameters.at("mass_kg").high, 0.2);
    } else {
      EXPECT_EQ(cause.effect + " " + cause.where, "encoder_offset tendon:2");
      EXPECT_NEAR(cause.parameters.at("rad").value, 0.3, 0.06);
    }
  }
}

/// A table of the first section's two motors and the tip, as a laboratory writes it.
std::string TableOfMotors(const std::string& name, const sim::TorqueProgram& program,
                          const sim::PlantMotion& motion) {
  constexpr Eigen::Index kEvery = 10;
  const std::string path = testing::TempDir() + name + ".csv";
  std::ofstream out(path);
  out << "t_s,motor_position_rad_1,motor_position_rad_2,tip_x_m,tip_y_m,tip_z_m\n" << std::setprecision(9);
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 1e-4);
  for (Eigen::Index i = 0; i < motion.tip_m.rows(); i += kEvery) {
    out << program.step_s * static_cast<double>(i) << ',' << motion.motor_angle_rad(i, 0) << ','
        << motion.motor_angle_rad(i, 1);
    for (int axis = 0; axis < 3; ++axis) out << ',' << motion.tip_m(i, axis) + noise(random);
    out << '\n';
  }
  return path;
}

// The plant has friction, inertia and one shaft a pair; the diagnosis sees two motors and the tip.
TEST(Postures, OfAPlantInPairsAreDiagnosedFromATableOfItsMotors) {
  const std::string file = TENDRIL_SOURCE_DIR "/config/robots/pairs_90mm.yaml";
  const RobotParameters robot = config::LoadRobot(file);
  RobotParameters heavy = robot;
  heavy.body.tip_payload_kg = 0.003;
  const std::vector<RobotParameters> robots = {robot, heavy};
  std::vector<std::string> tables;
  for (const double beat : {1.0, 1.3}) {  // other commands afterwards
    sim::TorqueProgram program{5e-3, Eigen::MatrixXd::Zero(18000, 4)};
    for (Eigen::Index i = 0; i < 18000; ++i) {
      const double t = 5e-3 * static_cast<double>(i), grows = std::min(1.0, t / 2);
      program.torque_Nm(i, 0) = 1e-3 * grows * (std::sin(0.31 * beat * t) + 0.6 * std::sin(0.71 * t));
      program.torque_Nm(i, 1) = 1e-3 * grows * (std::cos(0.43 * beat * t) + 0.6 * std::sin(0.59 * t));
    }
    const std::size_t which = tables.size();
    const auto motion = sim::SimulateEach({&robots[which], 1}, program, {}, 1).front();
    tables.push_back(TableOfMotors(which == 0 ? "pairs_before" : "pairs_after", program, motion));
  }
  DataSet set = LoadLogs({tables[1]}, file);
  EXPECT_THROW(Diagnose(set, DiagnoseOptions()), std::runtime_error) << "nothing to compare with";
  CompareWithBefore(set, LoadLogs({tables[0]}, file));
  DiagnoseOptions options;
  options.threads = 2;
  const Diagnosis d = Diagnose(set, options);
  ASSERT_FALSE(d.accepted.empty()) << d.sentence;
  EXPECT_EQ(d.accepted.front().effect, "tip_payload") << d.sentence;
  EXPECT_GT(d.accepted.front().p, 0.9);
  EXPECT_LT(d.accepted.front().parameters.at("mass_kg").low, 0.003);
  EXPECT_GT(d.accepted.front().parameters.at("mass_kg").high, 0.003);
  // What is learned is a robot that a file can hold: a pair's spool is one.
  const Calibration learned = Calibrate(LoadLogs({tables[0]}, file), CalibrateOptions());
  const auto& drives = learned.robot.actuation->tendons;
  EXPECT_NE(drives[0].spool.radius_m, robot.actuation->tendons[0].spool.radius_m);
  EXPECT_EQ(drives[0].spool.radius_m, drives[2].spool.radius_m);
  EXPECT_NO_THROW(config::ParseRobot(config::ToYaml(learned.robot), "learned"));
}

TEST(Postures, MotorsOfAPairThatDoNotMoveAsOneAreRefused) {
  const RobotParameters robot = InPairs(Hose());
  const gap::Run run = Moved(robot, "run", 1, 10);
  gap::Run whole = run;
  CompletePairs(robot, whole);
  EXPECT_EQ(whole.motor_position_rad, run.motor_position_rad);
  const auto refusal = [&](gap::Run of) -> std::string {
    try {
      CompletePairs(robot, of);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  };
  gap::Run alike = run;
  alike.motor_position_rad.col(2) *= -1;
  EXPECT_NE(refusal(alike).find("tendons 1 and 3, a pair on one motor, turn the same way"),
            std::string::npos);
  gap::Run exchanged = run;
  exchanged.motor_position_rad.col(2).swap(exchanged.motor_position_rad.col(3));
  EXPECT_NE(refusal(exchanged).find("move apart by"), std::string::npos);
  gap::Run zeroed = run;  // each column has its own zero
  zeroed.motor_position_rad.col(2).array() += 1;
  EXPECT_EQ(refusal(zeroed), "");
}

TEST(Postures, APayloadIsNamedWithItsSizeOnARobotThatIsNotWhatItsFileSays) {
  RobotParameters after = AsBuilt();
  after.body.tip_payload_kg = 0.2;
  const Diagnosis d = Diagnosed(after);
  EXPECT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  ASSERT_FALSE(d.causes.empty());
  EXPECT_EQ(d.causes.front().effect, "tip_payload") << d.sentence;
  EXPECT_GT(d.causes.front().p, 0.9);
  const Estimate mass = d.causes.front().parameters.at("mass_kg");
  EXPECT_LT(mass.low, 0.2);
  EXPECT_GT(mass.high, 0.2);
  ASSERT_TRUE(d.closed);
  EXPECT_GT(d.closed->value, 0.9);
  const auto first =
      std::find_if(d.location.begin(), d.location.end(), [](const auto& f) { return f.first; });
  ASSERT_NE(first, d.location.end());
  EXPECT_EQ(first->cut, sim::Cut::kShape);
  // The curves that a report shows are those that the figures were computed from.
  ASSERT_EQ(d.overlays.size(), d.closures.size());
  for (std::size_t c = 0; c < d.overlays.size(); ++c) {
    const Overlay& shown = d.overlays[c];
    EXPECT_EQ(shown.channel, d.closures[c].channel);
    EXPECT_EQ(shown.run, "after");
    EXPECT_EQ(shown.floor, d.closures[c].floor_rms);
    const Eigen::Index states = std::ssize(shown.time_s);
    const auto rms = [&](const std::vector<double>& model) {
      const Eigen::Map<const Eigen::VectorXd> measured(shown.measured.data(), states),
          modelled(model.data(), states);
      return (measured - modelled).norm() / std::sqrt(static_cast<double>(states));
    };
    ASSERT_EQ(shown.after.size(), shown.time_s.size());
    EXPECT_NEAR(rms(shown.before), d.closures[c].before_rms, 1e-9);
    EXPECT_NEAR(rms(shown.after), d.closures[c].after_rms, 1e-9);
  }
}

TEST(Postures, OrientationsAloneNameAPayload) {
  RobotParameters after = AsBuilt();
  after.body.tip_payload_kg = 0.2;
  const Diagnosis d = Diagnosed(after, Turned);
  EXPECT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.causes.front().effect, "tip_payload") << d.sentence;
  EXPECT_GT(d.causes.front().p, 0.9);
  const auto shape =
      std::find_if(d.location.begin(), d.location.end(), [](const auto& f) { return f.first; });
  ASSERT_NE(shape, d.location.end());
  EXPECT_EQ(shape->quantity, "disk orientation");
  EXPECT_EQ(shape->unit, "rad");
  EXPECT_LT(shape->floor, 6e-3);
  EXPECT_EQ(d.closures.front().channel, "turn of disk 2 about x");
  const Diagnosis same = Diagnosed(AsBuilt(), Turned);
  EXPECT_EQ(same.verdict, Verdict::kNoGap) << same.sentence;
}

TEST(Postures, PlacesAndTurnsTogetherSayMoreThanPlaces) {
  const gap::Run marked = Moved(AsBuilt(), "run", 1, 40);
  gap::Run both = Turned(AsBuilt(), "run", 1);
  const auto uncertain = [](const gap::Run& run) {
    const LearnedPostures learned = LearnPostures(Hose(), PosturesOf({&run}, Hose()), true, {.threads = 2});
    for (std::size_t k = 0; k < learned.numbers.size(); ++k) {
      if (learned.numbers[k].key != "body.sections[2].youngs_modulus_Pa") continue;
      const auto i = static_cast<Eigen::Index>(k);
      return std::sqrt(learned.precision.inverse()(i, i));
    }
    return 0.0;
  };
  both.disks_m = Moved(AsBuilt(), "run", 1).disks_m;
  const std::vector<Eigen::Index> first = [] {
    std::vector<Eigen::Index> rows(800);
    std::iota(rows.begin(), rows.end(), 0);
    return rows;
  }();
  for (Eigen::MatrixXd* values : {&both.motor_position_rad, &both.disks_m, &both.disk_quaternion})
    *values = (*values)(first, Eigen::all).eval();
  both.time_s = both.time_s(first).eval();
  EXPECT_LT(uncertain(both), uncertain(marked));
}

TEST(Postures, TheSameRobotHasNoGap) {
  const Diagnosis d = Diagnosed(AsBuilt());
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  for (const auto& f : d.location) EXPECT_FALSE(f.excess) << f.where;
}

TEST(Postures, ARobotThatCannotBeLearnedTellsNothing) {
  // The markers of another robot: what they show does not follow from these motors.
  const auto stranger = [](const RobotParameters& robot, const std::string& name, unsigned seed) {
    gap::Run run = Moved(robot, name, seed, 15);
    run.motor_position_rad = Moved(robot, name, seed + 7, 15).motor_position_rad;
    return run;
  };
  const Diagnosis d = Diagnosed(AsBuilt(), stranger);
  EXPECT_EQ(d.verdict, Verdict::kInsufficientData) << d.sentence;
  EXPECT_NE(d.sentence.find("cannot be learned from the runs before"), std::string::npos) << d.sentence;
  for (const Cause& cause : d.causes) {
    EXPECT_TRUE(cause.p <= 0.5 || cause.effect == "unknown") << cause.effect;
  }
  const auto calibrated_from = [](gap::Run run) {
    DataSet set;
    set.robot = Hose();
    set.runs = {std::move(run)};
    return Calibrate(set, CalibrateOptions());
  };
  const std::string why = calibrated_from(stranger(AsBuilt(), "run", 1)).not_learned;
  EXPECT_NE(why.find("cannot be learned from these runs"), std::string::npos) << why;
  EXPECT_EQ(calibrated_from(Moved(AsBuilt(), "run", 1, 15)).not_learned, "");
}

TEST(Postures, TwoPriorDeviationsAreTheBoundsOfTheRegistry) {
  for (const PostureChange& change : PostureChanges(Hose(), {})) {
    if (!change.effect) continue;
    for (int k = 0; k < change.size(); ++k) {
      const sim::EffectParameter& p = change.effect->parameters[static_cast<std::size_t>(k)];
      Eigen::VectorXd z = Eigen::VectorXd::Zero(change.size());
      EXPECT_DOUBLE_EQ(change.ValueAt(k, 0), p.nominal);
      EXPECT_EQ(change.OutOfRange(z), "");
      z[k] = 2.5;
      const double value = change.ValueAt(k, z[k]);
      EXPECT_TRUE(value > p.upper || -change.ValueAt(k, -z[k]) > -p.lower) << change.effect->effect->name;
      EXPECT_EQ(change.OutOfRange(z).empty(), value <= p.upper) << change.effect->effect->name;
    }
  }
}

TEST(Postures, OtherChangesAreNamedToo) {
  RobotParameters turned = AsBuilt();
  turned.effects.push_back({"encoder_offset", "tendon:2", {{"rad", 0.5}}});
  const Diagnosis zero = Diagnosed(turned);
  EXPECT_EQ(zero.causes.front().where, "tendon:2") << zero.sentence;
  EXPECT_TRUE(zero.causes.front().effect == "encoder_offset" || zero.causes.front().effect == "slack")
      << zero.sentence;
  RobotParameters soft = AsBuilt();
  for (auto& section : soft.body.sections) section.youngs_modulus_Pa *= 0.6;
  const Diagnosis stiffness = Diagnosed(soft);
  // Where positions are given, a softer body and stiffer tendons do nearly the same.
  double of_stiffness = 0;
  bool bending = false;
  for (const Cause& cause : stiffness.causes) {
    const bool either = cause.effect == "bending_stiffness" || cause.effect == "tendon_stiffness";
    if (either && cause.where == "all") of_stiffness += cause.p;
    bending |= cause.effect == "bending_stiffness" && cause.where == "all" && cause.p > 0.05;
  }
  EXPECT_GT(of_stiffness, 0.9) << stiffness.sentence;
  EXPECT_TRUE(bending) << stiffness.sentence;
}

TEST(Postures, ANumberThatIsNoEffectIsSuspected) {
  RobotParameters after = AsBuilt();
  for (auto& drive : after.actuation->tendons) drive.spool.radius_m *= 1.25;
  const Diagnosis d = Diagnosed(after);
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  ASSERT_FALSE(d.suspected.empty());
  bool spool = false;
  for (const auto& number : d.suspected) spool |= number.key == "actuation.spool.radius_m";
  EXPECT_TRUE(spool) << d.sentence;
  for (const Cause& cause : d.causes) {
    if (cause.effect == "unknown") continue;
    EXPECT_LT(cause.p, 0.5) << cause.effect;
  }
}

TEST(Postures, WhatNoHypothesisDoesIsUnknown) {
  DataSet set = Compared(AsBuilt(), AsBuilt());
  for (gap::Run& run : set.runs) {
    if (run.before.empty()) continue;
    // A push that turns with the third motor.
    const Eigen::ArrayXd push = run.motor_position_rad.col(2).array();
    run.disks_m.col(3) += (0.006 * push.square() * push.sign()).matrix();
    run.disks_m.col(9) -= (0.004 * push).matrix();
    run.disks_m.col(10) += (0.012 * push.abs()).matrix();
  }
  DiagnoseOptions options;
  options.refits = 4;
  const Diagnosis d = Diagnose(set, options);
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  for (const Cause& cause : d.causes) {
    if (sim::FindEffect(cause.effect) == nullptr) continue;
    EXPECT_LE(cause.p, 0.5) << cause.effect;
  }
  EXPECT_TRUE(d.suspected.empty()) << d.sentence;
}

TEST(Postures, ACalibrationWritesTheRobotThatMoved) {
  RobotParameters built = AsBuilt();
  for (int unit = 3; unit <= 4; ++unit) built.body.DeviationOf(unit).rest_u_rad = 0.06;
  built.body.gravity_W_mps2 = {0.5, 0, 9.8};
  const DataSet set{"set", Hose(), false, {Moved(built, "run", 1)}, {}};
  CalibrateOptions options;
  options.threads = 2;
  const Calibration found = Calibrate(set, options);
  EXPECT_TRUE(found.converged);
  ASSERT_EQ(found.channels.size(), 6u);
  for (const CalibratedChannel& c : found.channels) {
    const bool sideways = !c.name.ends_with('z');
    EXPECT_LT(c.held_out, sideways ? 0.6 * c.in_file : 5e-4) << c.name;
  }
  int file_numbers = 0, covered = 0;
  for (const CalibratedNumber& c : found.numbers) {
    EXPECT_LE(c.low, c.value) << c.key;
    EXPECT_GE(c.high, c.value) << c.key;
    if (c.key.starts_with("friction coefficient of")) {
      EXPECT_FALSE(c.of_file) << c.key;
      EXPECT_EQ(c.in_file, WithSheaths(Hose()).actuation->tendons[0].transmission.pulleys[0].alpha) << c.key;
      continue;
    }
    if (c.key == "wrap of the sheaths" || c.key.starts_with("pull in which")) {
      EXPECT_FALSE(c.of_file) << c.key;
      EXPECT_EQ(c.unit, c.key.starts_with("pull") ? "m" : "rad");
      continue;
    }
    if (!c.of_file) {
      EXPECT_EQ(c.in_file, 0) << c.key;
      EXPECT_FALSE(c.unit.empty()) << c.key;
      if (c.key.starts_with("zero of tendon")) {
        EXPECT_LT(std::abs(c.value), 0.25 * 0.025) << c.key;
      }
      continue;
    }
    for (const PostureNumber& number : PostureNumbers(Hose(), true, {})) {
      if (number.key != c.key) continue;
      const double truth = number.value(built);
      ++file_numbers;
      covered += c.low <= truth && truth <= c.high;
    }
  }
  EXPECT_GT(file_numbers, 30);
  EXPECT_GE(covered, 0.9 * file_numbers);

  // The file with them is that robot, and calibrates as well.
  const robot_file::RobotPatch patch =
      robot_file::PatchNumbers(config::ToYaml(Hose()), "hose.yaml", found.robot, {"calibrated"});
  for (const CalibratedNumber& c : found.numbers) {
    for (const PostureNumber& number : PostureNumbers(patch.robot, true, {})) {
      if (number.key != c.key || !number.value || number.assumed) continue;
      EXPECT_NEAR(number.value(patch.robot), c.value, 1e-9 * std::abs(c.value)) << c.key;
    }
  }
  DataSet again = set;
  again.robot = patch.robot;
  const Calibration better = Calibrate(again, options);
  for (std::size_t k = 0; k < better.channels.size(); ++k) {
    EXPECT_LT(better.channels[k].held_out, 1.1 * found.channels[k].held_out) << better.channels[k].name;
  }

  DataSet compared = Compared(AsBuilt(), AsBuilt());
  EXPECT_THROW(Calibrate(compared, options), std::runtime_error);
}

// Names exchanged for a second and a half, ghosts and dropouts of a quarter of the frames: named, masked, and
// the same robot learned.
TEST(Postures, DirectionsThatNobodyKnowsAreReadAndLearned) {
  RobotParameters sketch = Hose();
  for (std::size_t k = 0; k < 2; ++k) {
    for (std::size_t j = 0; j < 4; ++j) {
      sketch.body.sections[k].tendons[j].angle_rad = 0;
      sketch.uncertain["body.sections[" + std::to_string(k + 1) + "].tendons[" + std::to_string(j + 1) +
                       "].angle_rad"] = {Uncertainty::Kind::kUnknown, 0};
    }
  }
  const RobotParameters built = AsBuilt();
  DataSet set{"set", sketch, false, {Moved(built, "run", 1)}, {}};
  CalibrateOptions options;
  options.threads = 2;
  const Calibration found = Calibrate(set, options);
  for (std::size_t k = 0; k < 2; ++k) {
    for (std::size_t j = 0; j < 4; ++j) {
      const double off =
          found.robot.body.sections[k].tendons[j].angle_rad - built.body.sections[k].tendons[j].angle_rad;
      EXPECT_LT(std::abs(std::remainder(off, 2 * std::numbers::pi)), 0.06) << k << " " << j;
    }
  }
  for (const CalibratedChannel& c : found.channels) EXPECT_LT(c.held_out, 1.2e-3) << c.name;
  const auto says = [&](const std::string& words) {
    return std::any_of(found.notes.begin(), found.notes.end(),
                       [&](const std::string& line) { return line.find(words) != std::string::npos; });
  };
  EXPECT_TRUE(says("section 2: unknown directions of tendons begin"));

  // A motor that stands still tells nothing, and the file's value stays.
  gap::Run& run = set.runs.front();
  run.motor_position_rad.col(3).setZero();
  RobotParameters robot = sketch;
  const std::vector<std::string> lines = ReadDirections(PosturesOf({&run}, sketch), robot);
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_NE(lines[1].find("no direction can be read of tendons 4,"), std::string::npos) << lines[1];
  EXPECT_EQ(robot.body.sections[0].tendons[3].angle_rad, 0);
}

TEST(Postures, ReadingsThatCannotBeAreLeftOut) {
  DataSet set{"set", Hose(), false, {Moved(AsBuilt(), "run", 1)}, {}};
  CalibrateOptions options;
  options.threads = 2;
  const Calibration clean = Calibrate(set, options);
  gap::Run& run = set.runs.front();
  for (Eigen::Index row = 600; row < 630; ++row)
    run.disks_m.row(row).segment<3>(3).swap(run.disks_m.row(row).segment<3>(9));
  for (Eigen::Index row = 0; row < 2; ++row)
    run.disks_m.row(row).segment<3>(3).swap(run.disks_m.row(row).segment<3>(9));
  for (const Eigen::Index row : {101, 401, 2111}) run.disks_m(row, 10) += 0.05;
  run.disks_m.row(1800).segment<3>(3).setConstant(4);
  for (Eigen::Index row = 0; row < run.disks_m.rows(); row += 4)
    run.disks_m.row(row).segment<3>(9).setConstant(kNoReading);
  const Calibration found = Calibrate(set, options);
  std::string notes;
  for (const std::string& note : found.notes) notes += note + "\n";
  for (const char* part : {"each other's names in 32 frames, first at 0 s",
                           "disk 4 leaps away and back in 3 frames", "disk 2 x has 1 value"})
    EXPECT_NE(notes.find(part), notes.npos) << part << " is not in\n" << notes;
  for (std::size_t k = 0; k < found.channels.size(); ++k)
    EXPECT_LT(found.channels[k].held_out, 1.15 * clean.channels[k].held_out) << found.channels[k].name;
  ASSERT_EQ(clean.notes.size(), 2u);
  EXPECT_NE(clean.notes[0].find("neither torques nor tensions"), std::string::npos) << clean.notes[0];
  EXPECT_NE(clean.notes[1].find("no pulleys"), std::string::npos) << clean.notes[1];
}

TEST(Postures, MotorsWereWhereTheyWereALittleBefore) {
  gap::Run run;
  // Two readings in a burst, as of a log that begins late.
  run.time_s = Eigen::VectorXd::LinSpaced(40, -0.02, 0.76);
  run.time_s[0] = run.time_s[1] - 2e-6;
  run.motor_position_rad = run.time_s.array().sin().matrix();
  run.motor_position_rad(0, 0) += 2e-4;
  States states{"run", run.time_s, run.motor_position_rad, {}, {}, 0};
  states.path_s = run.time_s;
  states.path_rad = run.motor_position_rad;
  states.rows = {{0, 13}, {13, 13}, {26, 14}};
  for (const double lag_s : {-0.1, 0.03, 0.1}) {
    const Eigen::MatrixXd before = AnglesBefore(states, lag_s, 0);
    for (Eigen::Index s = 0; s < 3; ++s) {
      const States::Rows its = states.rows[static_cast<std::size_t>(s)];
      const Eigen::ArrayXd at = run.time_s.segment(its.first, its.count).array();
      EXPECT_NEAR(before(s, 0) - states.motor_rad(s, 0), ((at - lag_s).sin() - at.sin()).mean(), 3e-3) << s;
    }
  }
  // Where a state is one reading, nobody knows how the motor came there.
  states.rows.assign(40, {});
  for (Eigen::Index s = 0; s < 40; ++s) states.rows[static_cast<std::size_t>(s)] = {s, 1};
  EXPECT_EQ(AnglesBefore(states, 0.1, 0), states.motor_rad);
}

TEST(Postures, AClockThatDriftsIsFoundAndSaid) {
  constexpr double kGain = 2e-3;
  gap::Run run = Moved(AsBuilt(), "run", 1);
  const Eigen::MatrixXd seen = run.disks_m;
  const Eigen::Index last = run.time_s.size() - 1;
  for (Eigen::Index i = 0; i <= last; ++i) {
    // The log's time is the motors'; a marker that it has at t was seen at t / (1 + gain).
    const double at = static_cast<double>(i) / (1 + kGain);
    const auto before = static_cast<Eigen::Index>(at);
    const double share = at - static_cast<double>(before);
    run.disks_m.row(i) = (1 - share) * seen.row(before) + share * seen.row(std::min(before + 1, last));
  }
  const auto learned_from = [](const gap::Run& from) {
    return LearnPostures(Hose(), PosturesOf({&from}, Hose()), true, {.threads = 2});
  };
  const LearnedPostures drifting = learned_from(run);
  const auto of_clock = [](const LearnedPostures& learned) {
    for (std::size_t k = 0; k < learned.numbers.size(); ++k)
      if (learned.numbers[k].key == kClockDrift)
        return learned.numbers[k].ValueAt(Hose(), learned.x[static_cast<Eigen::Index>(k)]);
    return kNoReading;
  };
  EXPECT_NEAR(of_clock(drifting), kGain, 0.1 * kGain);
  EXPECT_EQ(ClockDriftText(drifting).rfind("the tracker's clock gains ", 0), 0u) << ClockDriftText(drifting);
  run.disks_m = seen;
  const LearnedPostures steady = learned_from(run);
  EXPECT_EQ(ClockDriftText(steady), "");
  EXPECT_LT(PointRms(drifting.held_out_m, 1), 1.1 * PointRms(steady.held_out_m, 1));
}

TEST(Postures, LeapsOfATrackerSlowerThanItsLogAreFound) {
  DataSet set{"set", Hose(), false, {Moved(Hose(), "run", 1, 30)}, {}};
  gap::Run& run = set.runs.front();
  run.time_s *= 0.2;  // 100 Hz, of which the tracker shows every fifth row
  for (Eigen::Index row = 0; row < run.disks_m.rows(); ++row) {
    if (row % 5 != 0) run.disks_m.row(row).setConstant(kNoReading);
  }
  const Eigen::MatrixXd before = run.disks_m;
  MaskImplausible(set);
  EXPECT_TRUE((run.disks_m.array() == before.array() || before.array().isNaN()).all());
  run.disks_m(205, 9) += 0.06;
  const Masked masked = MaskImplausible(set);
  ASSERT_EQ(masked.lines.size(), 1u);
  EXPECT_NE(masked.lines.front().find("disk 4 leaps away and back in 1 frame, first at 2.05 s"),
            std::string::npos)
      << masked.lines.front();
  EXPECT_TRUE(std::isnan(run.disks_m(205, 9)));
  EXPECT_FALSE(std::isnan(run.disks_m(205, 3)));
}

TEST(Postures, AreOfRunsWithoutTorqueAndTension) {
  gap::Run run = Moved(Hose(), "run", 1, 15);
  DataSet set{"set", Hose(), false, {run}, {}};
  EXPECT_TRUE(ShowsPostures(set));
  EXPECT_EQ(PostureStates(set), 60);
  EXPECT_TRUE(CanLearnPostures(set));
  EXPECT_FALSE(CanDiagnosePostures(set));  // nothing from before
  const std::vector<CutOfSet> cuts = CutsOf(set);
  EXPECT_TRUE(AnyCut(cuts));
  EXPECT_NE(CutsLine(cuts).find("C4 (with runs from before a change: --before)"), std::string::npos)
      << CutsLine(cuts);
  set.runs.front().motor_position_rad.col(1).setConstant(kNoReading);
  try {
    PostureStates(set);
    ADD_FAILURE() << "a motor that was not read";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("run run: no position of motor 2; accepted"), std::string::npos)
        << error.what();
  }
  EXPECT_FALSE(CanLearnPostures(set));
  set.runs.front() = run;
  set.runs.front().tension_N = Eigen::MatrixXd::Ones(run.time_s.size(), 8);
  EXPECT_EQ(PostureStates(set), std::nullopt);
  EXPECT_FALSE(ShowsPostures(set));
}

TEST(Postures, AChangeBelowWhatMattersIsNoGap) {
  RobotParameters after = AsBuilt();
  after.body.tip_payload_kg = 0.2;
  const DataSet set = Compared(AsBuilt(), after);
  DiagnoseOptions options;
  options.refits = 4;
  options.delta_m = 0.05;
  const Diagnosis d = Diagnose(set, options);
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_GE(d.delta_m, 0.05);
}

TEST(Postures, StatesAreMeansAndLeaveOutWhatWasNotRead) {
  gap::Run run = Moved(Hose(), "run", 1, 15);
  const Postures all = PosturesOf({&run}, Hose());
  EXPECT_EQ(all.points, (std::vector<PosturePoint>{{false, 1}, {false, 3}}));
  EXPECT_EQ(all.states(), 60);  // of a quarter of a second
  EXPECT_NEAR(all.runs[0].motor_rad(3, 0), run.motor_position_rad.col(0).segment(15, 5).mean(), 1e-12);
  EXPECT_EQ(all.runs[0].rows[3].first, 15);
  run.motor_position_rad(17, 0) = kNoReading;
  EXPECT_EQ(PosturesOf({&run}, Hose()).runs[0].path_rad(17, 0), run.motor_position_rad(16, 0));
  run.disks_m.col(3).segment(100, 20).setConstant(kNoReading);
  const Postures some = PosturesOf({&run}, Hose());
  EXPECT_EQ(some.states() + some.runs[0].lost, 60);
  EXPECT_EQ(some.runs[0].lost, 4);
  run.disks_m.setConstant(kNoReading);
  EXPECT_THROW(PosturesOf({&run}, Hose()), std::runtime_error);
}

TEST(Postures, ColumnsOfDisksAreReadAsWritten) {
  gap::Run run = Moved(Hose(), "run", 1, 5);
  run.disk_quaternion = Eigen::MatrixXd::Constant(run.time_s.size(), 16, kNoReading);
  run.disk_quaternion.middleCols(4, 4).rowwise() = Eigen::RowVector4d(0.8, 0, 0.6, 0);
  run.disk_quaternion.row(7).segment<4>(4) << 3, 0, 0, 0;
  const auto file = std::filesystem::temp_directory_path() / "tendril_postures_test.csv";
  WriteRun(run, file);
  const gap::Run back = ReadRunTable(file, Hose());
  std::filesystem::remove(file);
  ASSERT_EQ(back.disks_m.cols(), 12);
  for (const Eigen::Index c : {3, 4, 5, 9, 10, 11}) {
    EXPECT_EQ((back.disks_m.col(c) - run.disks_m.col(c)).cwiseAbs().maxCoeff(), 0) << c;
  }
  EXPECT_TRUE(back.disks_m.col(0).array().isNaN().all());
  ASSERT_EQ(back.disk_quaternion.cols(), 16);
  EXPECT_EQ(back.disk_quaternion.row(3).segment<4>(4), Eigen::RowVector4d(0.8, 0, 0.6, 0));
  EXPECT_TRUE(back.disk_quaternion.row(7).array().isNaN().all());
  ASSERT_FALSE(back.warnings.empty());
  EXPECT_NE(back.warnings.front().find("1 orientation (disk_qw_d"), std::string::npos)
      << back.warnings.front();
}

}  // namespace
}  // namespace tendril::gap
