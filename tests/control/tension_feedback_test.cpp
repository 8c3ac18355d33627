// The load cells' loop: derived gains keep their margins on every rig, by a simulation in fine steps that
// shares nothing with the design, and the integral knows that a tendon only pulls.
#include "tendril/control/tension_feedback.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <ctime>
#include <numbers>
#include <string>

#include "support/rig_file.h"
#include "tendril/model/body.h"

namespace tendril::control {
namespace {

using test::Rig;

// Largest tension error in the last of several seconds after a kick, relative to that in the first: rotors,
// tendons and the straight body's bending in small Euler steps, each drive with the loop under test.
double Decay(const RobotParameters& robot, TensionLoopGains gains, double loop_gain) {
  const model::Body body(robot.body);
  const int n = body.dof(), m = body.tendons();
  Eigen::VectorXd q = Eigen::VectorXd::Zero(n), dq = q;
  Eigen::MatrixXd mass(n, n), stiffness(n, n), lengths(m, n);
  model::Body::Workspace workspace(body);
  body.MassMatrix(q, mass, workspace);
  body.TangentStiffness(q, Eigen::VectorXd::Constant(m, robot.limits.min_tension_N), Eigen::Vector3d::Zero(),
                        stiffness);
  body.TendonLengthJacobian(q, lengths);
  const Eigen::LLT<Eigen::MatrixXd> factor(mass);
  std::vector<TensionFeedback> loop;
  for (int j = 0; j < m; ++j) loop.emplace_back(robot.actuation->tendons[j], robot.limits, gains, j, 1e-3);
  Eigen::VectorXd angle = Eigen::VectorXd::Zero(m), speed = angle, torque = angle, acting = angle,
                  sent = angle, tension = angle;
  speed[0] = 10;
  double first = 0, last = 0;
  constexpr int kCycles = 4000, kSteps = 400;
  for (int cycle = 0; cycle < kCycles; ++cycle) {
    for (int j = 0; j < m; ++j) {
      DriveFeedback f;
      f.position_counts = static_cast<std::int32_t>(std::lround(1e3 * angle[j]));  // of a finer encoder
      acting[j] = sent[j];
      sent[j] = loop_gain * loop[j].Step(f, 50 + tension[j], {.cell_N = 50, .motor_velocity_radps = 0}, true);
      (cycle < 500 ? first : last) = std::max(cycle < 500             ? first
                                              : cycle < kCycles - 500 ? 0
                                                                      : last,
                                              std::abs(tension[j]));
    }
    for (int i = 0; i < kSteps; ++i) {
      const double h = 1e-3 / kSteps;
      Eigen::VectorXd pull = Eigen::VectorXd::Zero(m);
      for (int j = 0; j < m; ++j) {
        const auto& t = robot.actuation->tendons[j];
        const double travel = t.SpoolTravelPerMotorRad();
        const double stretch = travel * angle[j] + lengths.row(j).dot(q);
        const double rate = travel * speed[j] + lengths.row(j).dot(dq);
        tension[j] = t.tendon.stiffness_Npm * stretch + t.tendon.damping_Nspm * rate;
        torque[j] += h / t.motor.torque_lag_s * (acting[j] - torque[j]);
        speed[j] += h / t.motor.rotor_inertia_kgm2 *
                    (torque[j] - travel * tension[j] - t.motor.viscous_friction_Nms * speed[j]);
      }
      dq += h * factor.solve(Eigen::VectorXd(-lengths.transpose() * tension - stiffness * q -
                                             robot.body.sections[0].bending_damping_Nms * dq));
      q += h * dq;
      angle += h * speed;
    }
  }
  return last / first;
}

RobotParameters WithFineEncoders(const std::string& name) {
  RobotParameters robot = Rig(name);
  for (auto& t : robot.actuation->tendons)
    t.drive.encoder_counts_per_turn = static_cast<int>(std::lround(2 * std::numbers::pi * 1e3));
  return robot;
}

TEST(TensionFeedback, DerivedGainsHoldTheirMarginsOnEveryRig) {
  for (const char* name : {"rig_60mm", "rig_90mm", "four_tendon_90mm", "two_section"}) {
    const RobotParameters robot = Rig(name);
    const TensionLoopGains gains = DesignTensionLoop(robot, 1e-3);
    ASSERT_GT(gains.bandwidth_radps, 1) << name;
    const TensionLoopMargins margins = CheckTensionLoop(robot, gains, 1e-3);
    EXPECT_EQ(gains.margins.gain, margins.gain) << name;
    EXPECT_EQ(gains.margins.phase_deg, margins.phase_deg) << name;
    EXPECT_TRUE(margins.stable) << name;
    EXPECT_GE(margins.gain, kLeastGainMargin) << name;
    EXPECT_GE(margins.phase_deg, kLeastPhaseMargin_deg) << name;
    for (const double stiffer : {0.5, 2.0}) {
      RobotParameters other = robot;
      for (auto& t : other.actuation->tendons) t.tendon.stiffness_Npm *= stiffer;
      EXPECT_TRUE(CheckTensionLoop(other, gains, 1e-3).stable)
          << name << ", tendons as stiff times " << stiffer;
    }
  }
}

TEST(TensionFeedback, ASimulationInFineStepsAgreesWithTheGainMargin) {
  RobotParameters robot = WithFineEncoders("rig_60mm");
  robot.limits.max_bending_rad = 0.01;  // the simulation is of the straight robot
  const TensionLoopGains gains = DesignTensionLoop(robot, 1e-3);
  const TensionLoopMargins margins = CheckTensionLoop(robot, gains, 1e-3);
  ASSERT_LT(margins.gain, kMostGainMargin);
  EXPECT_LT(Decay(robot, gains, 0.8 * margins.gain), 0.5);
  EXPECT_GT(Decay(robot, gains, 1.25 * margins.gain), 1);
}

// Only the ways to move that tendons meet are looked at. The margins are those of all of them, 20 and 40
// angles, found once with none left out; of 80 that took a minute and a half.
TEST(TensionFeedback, ManyUnitsHaveTheSameMarginsInASecondOrTwo) {
  struct Full {
    int units;
    double bandwidth_radps, proportional, gain, phase_deg;
  };
  for (const Full& full : {Full{10, 19.4716414556624, 0.192997483292155, 9.61785189500852, 90.9945118339195},
                           Full{20, 19.4716414556624, 0.181835429876826, 10.1230756986751, 94.1788398577013},
                           Full{40, 19.4716414556624, 0, 0, 0}}) {
    RobotParameters robot = Rig("rig_60mm");
    SectionParameters& section = robot.body.sections[0];
    const double share = static_cast<double>(section.units) / full.units;
    section.units = full.units;
    section.unit_length_m *= share;
    section.unit_mass_kg *= share;
    section.bending_damping_Nms /= share;
    const std::clock_t start = std::clock();
    const TensionLoopGains gains = DesignTensionLoop(robot, 1e-3);
    EXPECT_LT(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC, 15) << full.units << " units";
    EXPECT_GE(gains.margins.gain, kLeastGainMargin);
    EXPECT_GE(gains.margins.phase_deg, 90)
        << full.units << " units: where one tension more or less bends nothing";
    EXPECT_NEAR(gains.bandwidth_radps, full.bandwidth_radps, 1e-9);
    if (full.gain == 0) continue;
    EXPECT_NEAR(gains.proportional, full.proportional, 1e-6);
    EXPECT_NEAR(gains.margins.gain, full.gain, 1e-3 * full.gain);
    EXPECT_NEAR(gains.margins.phase_deg, full.phase_deg, 0.05);
  }
}

TEST(TensionFeedback, ASlowCycleLeavesLessBandwidthOrNone) {
  const RobotParameters robot = Rig("rig_60mm");
  const double fast = DesignTensionLoop(robot, 1e-3).bandwidth_radps;
  EXPECT_LT(DesignTensionLoop(robot, 5e-3).bandwidth_radps, fast);
}

class OneLoop : public testing::Test {
 protected:
  OneLoop()
      : robot(Rig("rig_60mm")),
        gains(DesignTensionLoop(robot, 1e-3)),
        loop(robot.actuation->tendons[0], robot.limits, gains, 0, 1e-3) {}
  double Step(double wanted_N, double measured_N, bool acts = true, double velocity_radps = 1e-3) {
    return loop.Step(
        still, measured_N,
        {.cell_N = wanted_N, .motor_velocity_radps = velocity_radps, .rests = velocity_radps == 0}, acts);
  }
  RobotParameters robot;
  TensionLoopGains gains;
  TensionFeedback loop;
  DriveFeedback still;
};

TEST_F(OneLoop, IntegratesWhatRemainsAndForgetsItWhenOff) {
  double torque = 0;
  for (int i = 0; i < 1000; ++i) torque = Step(1.1, 1.0);
  EXPECT_GT(torque, 0);
  const double after_one_s = torque;
  for (int i = 0; i < 1000; ++i) torque = Step(1.1, 1.0);
  EXPECT_NEAR(torque - after_one_s,
              0.1 * gains.integral_ps * robot.actuation->tendons[0].SpoolTravelPerMotorRad(), 1e-9);
  EXPECT_EQ(Step(1.1, 1.0, false), 0);
  EXPECT_LT(Step(1.1, 1.0), 1e-5);
}

// Dry friction would hold a motor at rest through half a newton here; an error within that stays as it is.
TEST_F(OneLoop, DoesNotIntegrateAgainstFrictionAtRest) {
  double torque = 0;
  for (int i = 0; i < 500; ++i) torque = Step(1.1, 1.0, true, 0);
  for (int i = 0; i < 5000; ++i)
    ASSERT_EQ(Step(1.1, i % 2 ? 1.0 : 1.01, true, 0), torque) << "nor passes noise on";
  for (int i = 0; i < 500; ++i) torque = Step(1.5, 1.0, true, 0);
  EXPECT_GT(Step(1.5, 1.0, true, 0), torque) << "more than friction is put right";
}

// The error at the start of a motion reaches the drive through the cell's low-pass and the integral.
TEST_F(OneLoop, SetsInWithoutABlow) {
  double torque = 0, largest = 0;
  for (int i = 0; i < 500; ++i) {
    const double now = Step(2, 1);
    largest = std::max(largest, std::abs(now - torque));
    torque = now;
  }
  EXPECT_GT(torque, 4e-4);
  EXPECT_LT(largest, 1e-5);
}

TEST_F(OneLoop, DoesNotWindUpAtALimitAndComesOffItAtOnce) {
  for (int i = 0; i < 500; ++i) Step(2, 1);
  const double at_limit = Step(2, 1);
  loop.Limited(1e-3);
  double torque = 0;
  for (int i = 0; i < 5000; ++i) torque = Step(2, 1);
  EXPECT_NEAR(torque, at_limit, 1e-6);
  for (int i = 0; i < 200; ++i) torque = Step(1, 2);
  EXPECT_LT(torque, at_limit) << "the other way it acts at once";
}

TEST_F(OneLoop, ASlackTendonIsTakenUpQuickly) {
  TensionFeedback other(robot.actuation->tendons[0], robot.limits, gains, 0, 1e-3);
  double slack = 0, taut = 0;
  for (int i = 0; i < 200; ++i) slack = Step(0.3, 0.0);
  for (int i = 0; i < 200; ++i)
    taut = other.Step(still, 0.7, {.cell_N = 1.0, .motor_velocity_radps = 0}, true);
  EXPECT_GT(slack, 3 * taut) << "the same error";
  for (int i = 0; i < 100000; ++i) slack = Step(0.3, 0.0);
  EXPECT_LT(slack,
            1.1 * robot.limits.max_tension_base_N * robot.actuation->tendons[0].SpoolTravelPerMotorRad())
      << "bounded, should the tendon have torn";
}

// While friction of the pulleys reverses, the reading of a cell before them is not predictable.
TEST_F(OneLoop, WhatThePulleysLeaveOpenIsNoError) {
  const auto step = [&](double measured_N) {
    return loop.Step(still, measured_N, {.cell_N = 1.0, .motor_velocity_radps = 1e-3, .uncertainty_N = 0.2},
                     true);
  };
  double torque = 0;
  for (int i = 0; i < 1000; ++i) torque = step(0.81);
  EXPECT_NEAR(torque, 0, 1e-6);
  TensionFeedback other(robot.actuation->tendons[0], robot.limits, gains, 0, 1e-3);
  double sure = 0;
  for (int i = 0; i < 1000; ++i) {
    torque = step(0.7);
    sure = other.Step(still, 0.9, {.cell_N = 1.0, .motor_velocity_radps = 1e-3}, true);
  }
  EXPECT_NEAR(torque, sure, 1e-6) << "what lies beyond counts";
}

TEST_F(OneLoop, AMotorAheadOfItsMotionIsHeldBack) {
  DriveFeedback f;
  double torque = 0;
  for (int i = 0; i < 50; ++i) {
    f.position_counts += 3;
    torque = loop.Step(f, 1.0, {.cell_N = 1.0, .motor_velocity_radps = 0}, true);
  }
  EXPECT_LT(torque, 0);
}

}  // namespace
}  // namespace tendril::control
