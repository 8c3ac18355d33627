// The shape that a robot would have had in a run, against what the plant that made the run shows to its
// tracker.
#include "tendril/gap/replayed_shape.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

#include "rig_runs.h"
#include "tendril/model/body.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using gap::ReplayedShape;
using testing::HasSubstr;

RobotParameters With(const std::string& effect) {
  RobotParameters robot = Rig();
  robot.effects.push_back(sim::ParseEffect(effect, robot));
  return robot;
}

/// Rms distance [m] of the replayed tip from the tracker's readings.
double TipOff(const RobotParameters& robot, const gap::Run& run) {
  const Eigen::MatrixXd q = ReplayedShape(robot, run, run.time_s);
  const model::Body body(sim::FoldEffects(robot).body);
  double square = 0, count = 0;
  for (Eigen::Index i = 0; i < q.rows(); ++i) {
    if (!run.tip_m.row(i).allFinite()) continue;
    EXPECT_TRUE(q.row(i).allFinite()) << "row " << i;
    square += (body.TipPose(q.row(i).transpose()).p_WA - run.tip_m.row(i).transpose()).squaredNorm();
    count += 1;
  }
  return std::sqrt(square / count);
}

TEST(ReplayedShape, OfTheRobotThatMadeTheRunIsWhatTheTrackerSaw) {
  const RobotParameters softer = With("bending_stiffness scale=0.9");
  const gap::Run run = Record(softer, "circle", 3, 5, 500);
  EXPECT_LT(TipOff(softer, run), 2e-4);
  EXPECT_GT(TipOff(Rig(), run), 1e-3);
}

TEST(ReplayedShape, FollowsTheMotorsWhereNoCellMeasures) {
  const RobotParameters softer = With("bending_stiffness scale=0.9");
  gap::Run run = Record(softer, "circle", 3, 5, 500);
  run.load_cell = LoadCellPlace::kNone;
  run.tension_N.resize(0, 0);
  EXPECT_LT(TipOff(softer, run), 1e-3);
}

TEST(ReplayedShape, IsOfTheTimesAskedFor) {
  const gap::Run run = Record(Rig(), "circle", 2, 5, 500);
  const Eigen::VectorXd times = (Eigen::VectorXd(5) << -0.1, 0.5, 0.501, 0.502, 99).finished();
  const Eigen::MatrixXd q = ReplayedShape(Rig(), run, times);
  ASSERT_EQ(q.rows(), 5);
  ASSERT_EQ(q.cols(), 8);
  EXPECT_TRUE(q.row(0).array().isNaN().all());
  EXPECT_TRUE(q.row(4).array().isNaN().all());
  EXPECT_LT((q.row(2) - 0.5 * (q.row(1) + q.row(3))).norm(), 1e-12);  // between two samples
}

TEST(ReplayedShape, RefusesWhatCannotDriveAModel) {
  gap::Run run = Record(Rig(), "circle", 1, 5, 500);
  gap::Run shortest = run;
  KeepRows(shortest, {0, 1, 2});
  run.load_cell = LoadCellPlace::kNone;
  run.tension_N.resize(0, 0);
  run.motor_position_rad.resize(0, 0);
  const auto error = [](const gap::Run& r) -> std::string {
    try {
      ReplayedShape(Rig(), r, r.time_s);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "none";
  };
  EXPECT_THAT(error(run), HasSubstr("neither load cells nor motor positions"));
  gap::Run without_one = Record(Rig(), "circle", 1, 5, 500);
  without_one.tension_N.col(1).setConstant(std::numeric_limits<double>::quiet_NaN());
  without_one.motor_position_rad.col(1).setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THAT(error(without_one), HasSubstr("neither tension nor motor position of tendon 2"));
  EXPECT_THAT(error(shortest), HasSubstr("too few rows"));
}

}  // namespace
}  // namespace tendril
