// Logs of states at rest, rows seconds apart, by a tracker in an unknown frame, as published tables of
// tendon-driven robots are. Compared with the motion in time, and with the planted effect.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>

#include "tendril/config/config.h"
#include "tendril/gap/diagnose.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/replay.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Run;
using gap::Verdict;

/// The rig with only motors and tip measured.
RobotParameters Bare() {
  RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml");
  for (auto& tendon : robot.actuation->tendons) tendon.load_cell.place = LoadCellPlace::kNone;
  return robot;
}

constexpr int kTendons = 3;
constexpr double kApart_s = 0.6;

/// Motor angles [rad] of a run of states: the tip moves out in a direction and back, or on a circle; tendons
/// on the other side are paid out.
Eigen::MatrixXd MotorAngles(const RobotParameters& robot, const std::string& family, int states, double way) {
  const auto& p = robot.actuation->tendons[0];
  const double to_rad = p.gear.ratio / p.spool.radius_m;  // of the motor by metre of tendon
  Eigen::MatrixXd angle(states, kTendons);
  for (int i = 0; i < states; ++i) {
    const double part = static_cast<double>(i) / (states - 1);
    const double size = 0.004 * (family == "round" ? std::min(1.0, 4 * part) : 1 - std::abs(2 * part - 1));
    const double towards = way + (family == "round" ? 2 * std::numbers::pi * part : 0);
    for (int j = 0; j < kTendons; ++j) {
      const double pull = size * std::cos(towards - robot.body.sections[0].tendons[j].angle_rad);
      angle(i, j) = to_rad * (family == "taut" ? std::max(pull, 0.3 * pull) : pull);
    }
  }
  return angle;
}

/// Motor positions and tip of a robot, the tip in the tracker's own frame; `each` states a run.
DataSet States(const RobotParameters& plant, const Eigen::Isometry3d& frame, int each = 31) {
  constexpr double kNoise_m = 1e-4;
  DataSet set;
  set.robot = Bare();
  set.fit_frame = true;
  const sim::Replay replay(plant);
  std::mt19937_64 random(5);
  std::normal_distribution<double> noise(0, kNoise_m);
  int number = 0;
  for (const char* family : {"out", "round", "taut"}) {
    for (const double way : {0.3, 2.5, 4.4}) {
      Run run;
      run.name = std::string(family) + std::to_string(++number);
      run.family = family;
      run.load_cell = LoadCellPlace::kNone;
      run.motor_position_rad = MotorAngles(set.robot, family, each, way);
      const Eigen::Index states = run.motor_position_rad.rows();
      run.time_s = Eigen::VectorXd::LinSpaced(states, 0, kApart_s * static_cast<double>(states - 1));
      sim::ReplaySignals s;
      s.step_s = kApart_s;
      s.at_rest = true;
      s.load_cell = LoadCellPlace::kNone;
      s.motor_angle_rad = run.motor_position_rad;
      run.tip_m = replay.Body(s, sim::Replay::DrivenBy::kMotor).tip_m;
      for (Eigen::Index i = 0; i < states; ++i) {
        const Eigen::Vector3d seen = frame * Eigen::Vector3d(run.tip_m.row(i).transpose());
        for (int axis = 0; axis < 3; ++axis) run.tip_m(i, axis) = seen[axis] + noise(random);
      }
      set.runs.push_back(std::move(run));
    }
  }
  return set;
}

Eigen::Isometry3d Frame() {
  Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
  frame.linear() = Eigen::AngleAxisd(2.1, Eigen::Vector3d(0.2, -0.4, 0.9).normalized()).toRotationMatrix();
  frame.translation() = Eigen::Vector3d(0.31, -0.12, 0.75);
  return frame;
}

gap::DiagnoseOptions Quick() {
  gap::DiagnoseOptions options;
  options.refits = 4;
  options.threads = 2;
  return options;
}

TEST(States, AreWhereMotionComesToRest) {
  const RobotParameters robot = Bare();
  const Eigen::MatrixXd angles_rad = MotorAngles(robot, "round", 9, 0.7);
  sim::ReplaySignals states;
  states.step_s = kApart_s;
  states.at_rest = true;
  states.load_cell = LoadCellPlace::kNone;
  states.motor_angle_rad = angles_rad;
  const Eigen::MatrixXd tip = sim::Replay(robot).Body(states, sim::Replay::DrivenBy::kMotor).tip_m;

  // The same in time: a second from state to state, and two of holding.
  constexpr double kStep_s = 0.005;
  constexpr int kGo = 200, kHold = 400;
  const int samples = static_cast<int>(angles_rad.rows()) * (kGo + kHold);
  sim::ReplaySignals motion;
  motion.step_s = kStep_s;
  motion.load_cell = LoadCellPlace::kNone;
  motion.motor_angle_rad.resize(samples, kTendons);
  motion.motor_velocity_radps.setZero(samples, kTendons);
  for (int i = 0; i < samples; ++i) {
    const int state = i / (kGo + kHold);
    const double part = std::min(1.0, static_cast<double>(i % (kGo + kHold)) / kGo);
    const auto from = angles_rad.row(std::max(0, state - 1)), to = angles_rad.row(state);
    motion.motor_angle_rad.row(i) = from + part * (to - from);
    if (part < 1) motion.motor_velocity_radps.row(i) = (to - from) / (kGo * kStep_s);
  }
  const Eigen::MatrixXd moved = sim::Replay(robot).Body(motion, sim::Replay::DrivenBy::kMotor).tip_m;
  for (int k = 0; k < angles_rad.rows(); ++k) {
    const double apart = (moved.row((k + 1) * (kGo + kHold) - 1) - tip.row(k)).norm();
    EXPECT_LT(apart, 2e-4) << "state " << k;  // of 40 mm; pulleys' friction holds what is left of a swing
  }
}

TEST(States, ACauseIsFoundThroughAnUnknownFrame) {
  RobotParameters plant = Bare();
  plant.effects.push_back(sim::ParseEffect("hole_radius where=all scale=0.9", plant));
  const Diagnosis d = gap::Diagnose(States(plant, Frame()), Quick());
  ASSERT_FALSE(d.accepted.empty()) << d.sentence;
  // A spool that is too large does the same except for the tendons' stretch.
  bool named = false;
  for (const auto& cause : d.causes) {
    if (cause.effect != "hole_radius" || cause.where != "all") continue;
    named = cause.p > 0.5 || cause.group == d.accepted.front().group;
    if (d.accepted.front().effect == "hole_radius") {
      EXPECT_NEAR(cause.parameters.at("scale").value, 0.9, 0.01);
    }
  }
  EXPECT_TRUE(named) << d.sentence;
  ASSERT_TRUE(d.closed);
  EXPECT_GT(d.closed->value, 0.95);
  // Motion was not recorded, and the report says how the rows are compared.
  std::string notes;
  for (const auto& line : d.degradations) notes += line + "\n";
  EXPECT_NE(notes.find("the tracker's frame is unknown"), notes.npos) << notes;
  EXPECT_NE(notes.find("at rest at each row"), notes.npos) << notes;
  // Family by family, on held-out runs.
  ASSERT_EQ(d.families.size(), 3u);
  for (const auto& family : d.families) {
    EXPECT_EQ(family.runs, 3);
    EXPECT_LT(family.after_m, 0.3 * family.before_m) << family.family;
  }
}

TEST(States, AWrongFrameAloneIsNoGap) {
  const Diagnosis d = gap::Diagnose(States(Bare(), Frame()), Quick());
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
}

// States so close together that motors seem to move smoothly, with a gap: not a motion with its time in
// milliseconds.
TEST(States, ManyOfThemAreStates) {
  RobotParameters plant = Bare();
  plant.effects.push_back(sim::ParseEffect("hole_radius where=all scale=0.9", plant));
  DataSet set = States(plant, Frame(), 120);
  set.runs.erase(set.runs.begin() + 1, set.runs.end() - 1);
  gap::DiagnoseOptions options = Quick();
  options.menu.families.clear();
  for (const auto& effect : sim::Effects()) {
    if (effect.name != "hole_radius") options.without.emplace_back(effect.name);
  }
  EXPECT_EQ(gap::Diagnose(set, options).runs.size(), set.runs.size());
}

TEST(States, ShortRunsAreLeftOutAndReported) {
  DataSet set = States(Bare(), Frame());
  gap::Run& run = set.runs.back();
  run.time_s.conservativeResize(4);
  run.motor_position_rad.conservativeResize(4, kTendons);
  run.tip_m.conservativeResize(4, 3);
  const Diagnosis d = gap::Diagnose(set, Quick());
  EXPECT_EQ(d.runs.size(), set.runs.size() - 1);
  ASSERT_FALSE(d.degradations.empty());
  EXPECT_NE(d.degradations.front().find("too short"), std::string::npos) << d.degradations.front();
  set.runs.erase(set.runs.begin(), set.runs.end() - 1);
  EXPECT_THROW(gap::Diagnose(set, Quick()), std::runtime_error);
}

TEST(States, AFrameCannotBeFittedToALine) {
  DataSet set = States(Bare(), Frame());
  for (gap::Run& run : set.runs) {
    // The robot stands still.
    run.motor_position_rad.setZero();
    for (Eigen::Index i = 0; i < run.tip_m.rows(); ++i) run.tip_m.row(i) = run.tip_m.row(0);
  }
  EXPECT_THROW(gap::Diagnose(set, Quick()), std::runtime_error);
}

}  // namespace
}  // namespace tendril
