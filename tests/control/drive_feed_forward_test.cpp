// The motor's torque for a desired tension and motion, against the drivetrain's laws written out by hand.
#include "tendril/control/drive_feed_forward.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tendril/config/config.h"

namespace tendril::control {
namespace {

class DriveFeedForwardTest : public testing::Test {
 protected:
  DriveFeedForwardTest()
      : robot(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml")),
        drive(robot.actuation->tendons[0]),
        table(std::make_shared<const model::CapstanTable>(drive.transmission,
                                                          robot.limits.max_tension_motor_N)) {}

  // On arcs.
  static DriveFeedForward::Result Step(DriveFeedForward& f, double tension_N, double shortening_m) {
    return f.Step(tension_N, shortening_m, shortening_m, true);
  }
  DriveFeedForward Make(bool capstan = true) {
    return {drive, robot.limits, capstan, Pulled(drive, robot.limits.min_tension_N, table), 1e-3};
  }

  RobotParameters robot;
  TendonDriveParameters drive;
  std::shared_ptr<const model::CapstanTable> table;
};

TEST_F(DriveFeedForwardTest, SteadyPullAddsEveryLoss) {
  DriveFeedForward f = Make();
  f.Reset(3, 0);
  DriveFeedForward::Result r;
  constexpr double kSpeed_mps = 2e-3;
  for (int i = 1; i <= 300; ++i) r = Step(f, 3, i * kSpeed_mps * 1e-3);
  const double w = kSpeed_mps / (0.008 / 19);
  EXPECT_EQ(r.sliding, 1);
  EXPECT_NEAR(r.motor_velocity_radps, w, 1e-9);
  EXPECT_NEAR(r.tension_motor_N, model::SolveCapstan(drive.transmission.pulleys, 3.0), 3e-6);
  EXPECT_NEAR(r.torque_Nm, r.tension_motor_N * 0.008 / 19 / 0.84 + 2e-4 + 1e-7 * w, 1e-10);
}

TEST_F(DriveFeedForwardTest, TheRotorIsTurnedFasterByItsOwnTorque) {
  DriveFeedForward f = Make();
  f.Reset(3, 0);
  DriveFeedForward::Result slow, r;
  constexpr double kAcceleration_mps2 = 0.5;
  for (int i = 1; i <= 300; ++i) r = Step(f, 3, 0.5 * kAcceleration_mps2 * i * i * 1e-6);
  const double w = r.motor_velocity_radps;
  EXPECT_NEAR(r.torque_Nm - r.tension_motor_N * 0.008 / 19 / 0.84 - 2e-4 - 1e-7 * w,
              4.1e-7 * kAcceleration_mps2 / (0.008 / 19), 1e-9);
}

// What the motor side carries is what the base then gets through the same pre-sliding.
TEST_F(DriveFeedForwardTest, InTheMiddleOfAReversalTheBaseGetsWhatIsWanted) {
  DriveFeedForward f = Make();
  model::StopOperators<4> pulley = model::PulleyPresliding(drive.transmission.presliding_m);
  f.Reset(1, 0);
  double worst = 0;
  for (int i = 1; i <= 4000; ++i) {
    const double d = 1e-4 * (1 - std::cos(2 * std::numbers::pi * i / 2000));
    const auto r = Step(f, 1, d);
    const double z = pulley.Commit(d + 0.5 * (r.tension_motor_N - robot.limits.min_tension_N) / 3e4 -
                                   0.5 * (1 - robot.limits.min_tension_N) / 3e4);
    worst = std::max(worst, std::abs(table->MotorToBase(r.tension_motor_N, z) - 1));
  }
  EXPECT_LT(worst, 2e-3);
}

// A back-and-forth motion of 0.2 mm, three times: largest change of torque in a cycle, also of those cycles
// in which it exceeds what the motion of that cycle covers of the angle over which the losses turn.
struct Jump {
  double largest_Nm = 0, beyond_motion_Nm = 0;
};
Jump LargestJump(DriveFeedForward f, double tension_N, double turned_Nm, double period_s) {
  f.Reset(tension_N, 0);
  const auto step = [&](double d) { return f.Step(tension_N, d, d, true); };
  for (int i = 0; i < 1000; ++i) step(0);
  double last = step(0).torque_Nm;
  const int cycles = static_cast<int>(std::lround(1e3 * period_s));
  Jump jump;
  for (int i = 0; i < 3 * cycles; ++i) {
    const auto r = step(1e-4 * (1 - std::cos(2 * std::numbers::pi * i / cycles)));
    // A fast motion begins with a jump of its acceleration, and so of the rotor's torque.
    const double change_Nm = i < 3 && period_s < 2 ? 0 : std::abs(r.torque_Nm - last);
    jump.largest_Nm = std::max(jump.largest_Nm, change_Nm);
    const double covered = std::abs(r.motor_velocity_radps) * 1e-3 / 0.008;
    jump.beyond_motion_Nm = std::max(jump.beyond_motion_Nm, change_Nm - turned_Nm * covered);
    last = r.torque_Nm;
  }
  for (int i = 0; i < 1000; ++i) last = step(0).torque_Nm;
  for (int i = 0; i < 1000; ++i)
    EXPECT_EQ(step(0).torque_Nm, last) << "chatter at rest, " << tension_N << " N";
  return jump;
}

// Under all tensions that the robot has. Slow motions (those of a circle of 10 s turn round with a fiftieth
// of the 1e-3 m/s^2 that a period of 2 s has): never more than 50 uNm, a quarter of what dry friction holds.
// Faster ones pass the angle over which losses turn in fewer cycles; then a cycle may turn its share.
TEST_F(DriveFeedForwardTest, NoTorqueJumpsAtAReversal) {
  for (const double tension_N : {0.3, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.5}) {
    const double motor_N = table->Pull(tension_N);
    const double turned_Nm = motor_N * 0.008 / 19 * (1 / 0.84 - 0.84) + 2 * 2e-4;
    for (const double period_s : {10., 5., 2., 1., 0.5, 0.2}) {
      const Jump jump = LargestJump(Make(), tension_N, turned_Nm, period_s);
      EXPECT_LT(jump.beyond_motion_Nm, 5e-5) << tension_N << " N, " << period_s << " s";
      EXPECT_LT(jump.largest_Nm, period_s >= 2 ? 5e-5 : 0.25 * turned_Nm)
          << tension_N << " N, " << period_s << " s";
    }
  }
}

// The base still gets the desired tension, except while friction reverses under high tension. The reversal
// ends, with the base within a hundredth of a newton, before the motion has covered the pre-sliding of
// pulleys and tendon.
TEST_F(DriveFeedForwardTest, UnderHighTensionTheFrictionIsLedAcrossAndThenRight) {
  DriveFeedForward f = Make();
  model::StopOperators<4> pulley = model::PulleyPresliding(drive.transmission.presliding_m);
  f.Reset(5, 0);
  double worst_after_N = 0;
  for (int i = 1; i <= 4000; ++i) {
    const double d = 1e-4 * (1 - std::cos(2 * std::numbers::pi * i / 2000));
    const auto r = Step(f, 5, d);
    const double z = pulley.Commit(d + 0.5 * (r.tension_motor_N - 5) / 3e4);
    const bool turned = (i > 500 && i < 1000) || (i > 1500 && i < 2000) || (i > 2500 && i < 3000);
    if (turned)
      worst_after_N = std::max(worst_after_N, std::abs(table->MotorToBase(r.tension_motor_N, z) - 5));
  }
  EXPECT_LT(worst_after_N, 0.01);
}

// Where a stretched tendon's path folds, the smallest way back would turn all friction by itself.
TEST_F(DriveFeedForwardTest, ATendonThatStoppedIsNotTurnedRoundByAStir) {
  DriveFeedForward f = Make();
  f.Reset(5, 0);
  DriveFeedForward::Result r;
  for (int i = 0; i <= 1000; ++i) r = Step(f, 5, 2e-4 * (1 - std::cos(std::numbers::pi * i / 1000)));
  ASSERT_EQ(r.sliding, 1);
  const double pulled_N = r.tension_motor_N;
  for (int i = 0; i < 3000; ++i) r = Step(f, 5, 4e-4 - 1e-7 * std::min(1., i / 100.));
  EXPECT_GT(r.tension_motor_N, pulled_N - 0.05) << "of " << pulled_N - table->Release(5) << " N in all";
}

TEST_F(DriveFeedForwardTest, WithoutCapstanOnlyThePulleysAreFree) {
  DriveFeedForward f = Make(false);
  f.Reset(3, 0);
  DriveFeedForward::Result r;
  for (int i = 1; i <= 300; ++i) r = Step(f, 3, i * 1e-6);
  EXPECT_NEAR(r.tension_motor_N, 3, 1e-12);
}

TEST_F(DriveFeedForwardTest, LimitsSayWhichOneActs) {
  LimitParameters tight = robot.limits;
  tight.max_tension_motor_N = 4;
  DriveFeedForward by_tension(drive, tight, true, Pulled(drive, tight.min_tension_N, table), 1e-3);
  DriveFeedForward::Result r;
  for (int i = 1; i <= 1000; ++i) r = Step(by_tension, 5, i * 1e-6);
  EXPECT_EQ(r.tension_motor_N, 4);
  EXPECT_EQ(r.status, Status::kLimitedMotorTension);
  drive.drive.current_limit_A = 0.1;
  DriveFeedForward by_torque = Make();
  for (int i = 1; i <= 1000; ++i) r = Step(by_torque, 5, i * 1e-6);
  EXPECT_NEAR(r.torque_Nm, 0.0196 * 0.1, 1e-15);
  EXPECT_EQ(r.status, Status::kLimitedTorque);
}

}  // namespace
}  // namespace tendril::control
