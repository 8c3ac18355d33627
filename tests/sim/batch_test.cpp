// Many plants at once: each as it is alone, whatever the threads; what is wrong is told, and nothing is lost.
#include "tendril/sim/batch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "motions.h"
#include "tendril/sim/effects.h"

namespace tendril::sim {
namespace {

using test::Rig;
using testing::HasSubstr;
using testing::ThrowsMessage;

TorqueProgram Circle(const RobotParameters& robot, int steps) {
  const test::CircleTorque circle(robot);
  TorqueProgram program{2e-3, Eigen::MatrixXd(steps, robot.body.tendons())};
  for (int i = 0; i < steps; ++i) program.torque_Nm.row(i) = circle.At(i * program.step_s).transpose();
  return program;
}

std::vector<RobotParameters> Family() {
  std::vector<RobotParameters> robots(4, Rig());
  robots[1].effects = {{"tip_payload", "all", {{"mass_kg", 0.003}}}};
  robots[2].effects = {{"backlash", "tendon:2", {{"rad", 0.2}}}};
  robots[3] = Rig("rod_90mm");
  return robots;
}

TEST(Batch, EachRobotMovesAsAloneWhateverTheThreads) {
  const auto robots = Family();
  const TorqueProgram program = Circle(robots[0], 300);
  const auto one = SimulateEach(robots, program, {}, 1), four = SimulateEach(robots, program, {}, 4);
  ASSERT_EQ(one.size(), robots.size());
  for (std::size_t i = 0; i < robots.size(); ++i) {
    EXPECT_EQ(one[i].failed, "");
    EXPECT_EQ(one[i].tip_m, four[i].tip_m);
    EXPECT_EQ(one[i].tension_base_N, four[i].tension_base_N);
    Plant alone(robots[i]);
    for (int row = 0; row < 300; ++row) {
      alone.SetTorque(program.torque_Nm.row(row).transpose());
      alone.Advance(2 * kNsPerMs);
    }
    EXPECT_EQ(one[i].tip_m.row(299), alone.TipPose().p_WA.transpose());
    EXPECT_EQ(one[i].motor_angle_rad(299, 1), alone.tendon()[1].motor_angle_rad);
  }
  EXPECT_GT((one[0].tip_m - one[1].tip_m).norm(), 1e-5);
  EXPECT_GT((one[0].bending_rad.rightCols(2) - one[2].bending_rad.rightCols(2)).norm(), 1e-4);
}

TEST(Batch, WhatIsWrongIsToldBeforeAnythingIsComputed) {
  const auto robots = Family();
  const auto refusal = [&](TorqueProgram program, std::vector<RobotParameters> of) {
    EXPECT_THROW(SimulateEach(of, program, {}, 2), std::invalid_argument);
    try {
      SimulateEach(of, program, {}, 2);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  TorqueProgram good = Circle(robots[0], 3);
  EXPECT_THAT(refusal({2e-3, Eigen::MatrixXd(0, 3)}, robots), HasSubstr("at least one row"));
  EXPECT_THAT(refusal({0, good.torque_Nm}, robots), HasSubstr("accepted: 1e-5 to 1"));
  EXPECT_THAT(refusal(good, {Rig(), Rig("four_tendon_90mm")}),
              HasSubstr("robot 2 ('four_tendon_90mm') has 4 tendons"));
  EXPECT_THAT(refusal(good, {Rig("qi2021_90mm")}), HasSubstr("no actuation"));
  good.torque_Nm(1, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(refusal(good, robots), HasSubstr("not finite"));
}

TEST(Batch, AStopLeavesTheRestUnknownAndProgressEndsAtAll) {
  const auto robots = Family();
  const TorqueProgram program = Circle(robots[0], 250);
  const std::atomic<bool> stop = true;
  const auto stopped = SimulateEach(robots, program, {}, 2, &stop);
  EXPECT_TRUE(std::isnan(stopped[0].tip_m(0, 0)));
  double last = 0;
  SimulateEach(robots, program, {}, 1, nullptr, [&](double share) { last = share; });
  EXPECT_EQ(last, 1);
  EXPECT_TRUE(SimulateEach({}, program, {}, 2).empty());
}

TEST(Batch, AMotionOfTooManySolverStepsIsGivenUp) {
  const std::vector<RobotParameters> robots = {Rig()};
  const TorqueProgram program = Circle(robots[0], 250);
  EXPECT_EQ(SimulateEach(robots, program, {}, 1, nullptr, {}, 100)[0].failed, "");
  const auto given_up = SimulateEach(robots, program, {}, 1, nullptr, {}, 0.1);
  EXPECT_THAT(given_up[0].failed, HasSubstr("too slow"));
  EXPECT_TRUE(std::isfinite(given_up[0].tip_m(0, 0)));
  EXPECT_TRUE(std::isnan(given_up[0].tip_m(249, 0)));
}

}  // namespace
}  // namespace tendril::sim
