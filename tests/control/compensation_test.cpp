// The torque that gives a desired base tension, checked against the friction chain written out by hand.
#include "tendril/control/compensation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tendril/config/config.h"

namespace tendril::control {
namespace {

class CompensationTest : public testing::Test {
 protected:
  CompensationTest()
      : robot(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml")),
        drive(robot.actuation->tendons[0]),
        table(std::make_shared<const model::CapstanTable>(drive.transmission,
                                                          robot.limits.max_tension_motor_N)) {}

  Compensation Make(bool capstan) {
    return {drive, robot.limits, capstan, Pulled(drive, robot.limits.min_tension_N, table)};
  }

  RobotParameters robot;
  TendonDriveParameters drive;
  std::shared_ptr<const model::CapstanTable> table;
};

TEST_F(CompensationTest, PullingAddsEveryLoss) {
  Compensation c = Make(true);
  c.Reset(3, 0);
  Compensation::Result r;
  for (int i = 1; i <= 100; ++i) r = c.Step(3, i * 1e-6, true);  // 0.1 mm of pull: twice the pre-sliding
  EXPECT_EQ(r.sliding, 1);
  EXPECT_NEAR(r.tension_motor_N, model::SolveCapstan(drive.transmission.pulleys, 3.0), 3e-6);
  EXPECT_NEAR(r.torque_Nm, r.tension_motor_N * 0.008 / 19 / 0.84 + 2e-4, 1e-12);
}

TEST_F(CompensationTest, PayingOutSubtractsEveryLossAndMayTurnNegative) {
  Compensation c = Make(true);
  c.Reset(0.3, 0);
  Compensation::Result r;
  for (int i = 1; i <= 100; ++i) r = c.Step(0.3, -i * 1e-6, true);
  EXPECT_EQ(r.sliding, -1);
  EXPECT_NEAR(r.tension_motor_N, model::SolveCapstanInverse(drive.transmission.pulleys, 0.3), 1e-6);
  EXPECT_NEAR(r.torque_Nm, r.tension_motor_N * 0.008 / 19 * 0.84 - 2e-4, 1e-12);
  EXPECT_LT(r.torque_Nm, 0);
}

TEST_F(CompensationTest, OffReplacesOnlyThePulleyMapByTheIdentity) {
  Compensation c = Make(false);
  c.Reset(3, 0);
  Compensation::Result r;
  for (int i = 1; i <= 100; ++i) r = c.Step(3, i * 1e-6, true);
  EXPECT_EQ(r.tension_motor_N, 3);
  EXPECT_NEAR(r.torque_Nm, 3 * 0.008 / 19 / 0.84 + 2e-4, 1e-12);
}

TEST_F(CompensationTest, BearingsOfThePulleysAreCarriedOnTopOfTheWantedTension) {
  drive.transmission.coulomb_N = 0.2;
  Compensation c = Make(true);
  c.Reset(3, 0);
  Compensation::Result r;
  for (int i = 1; i <= 100; ++i) r = c.Step(3, i * 1e-6, true);
  EXPECT_NEAR(r.tension_motor_N, model::SolveCapstan(drive.transmission.pulleys, 3.2), 3e-6);
  for (int i = 1; i <= 200; ++i) r = c.Step(3, 1e-4 - i * 1e-6, true);
  EXPECT_NEAR(r.tension_motor_N, model::SolveCapstanInverse(drive.transmission.pulleys, 2.8), 3e-6);
  EXPECT_EQ(Make(false).Step(3, 0, true).tension_motor_N, 3);
}

TEST_F(CompensationTest, AMotorStrongerThanItsDataSheetIsSentLess) {
  const double nominal = Make(true).Step(3, 0, true).torque_Nm;
  drive.motor.torque_scale = 1.25;
  Compensation c = Make(true);
  EXPECT_NEAR(c.Step(3, 0, true).torque_Nm, nominal / 1.25, 1e-15);
  EXPECT_EQ(c.max_torque_Nm(), 0.0196 * 0.36);  // the drive's limit is one of current
}

TEST_F(CompensationTest, NoJumpAtAReversal) {
  Compensation c = Make(true);
  c.Reset(2, 0);
  double last = c.Step(2, 0, true).torque_Nm;
  const double full_swing = 2 * 2e-4 + 2 * 0.008 / 19 * 3;  // a generous bound of the whole change
  for (int i = 0; i < 4000; ++i) {
    const double pull = 2e-4 * std::sin(i * 2 * std::numbers::pi / 2000);  // up to 0.63 um a step
    const double torque = c.Step(2, pull, true).torque_Nm;
    EXPECT_LT(std::abs(torque - last), full_swing * 0.63e-6 / 12.5e-6);
    last = torque;
  }
}

TEST_F(CompensationTest, SlidingStaysWhenTheShapeIsNotControlled) {
  Compensation c = Make(true);
  c.Reset(2, 0);
  for (int i = 1; i <= 100; ++i) c.Step(2, i * 1e-6, true);
  EXPECT_EQ(c.Step(0.1, -1e-3, false).sliding, 1);
}

TEST_F(CompensationTest, LimitsSayWhichOneActs) {
  LimitParameters tight = robot.limits;
  tight.max_tension_motor_N = 4;
  Compensation by_tension(drive, tight, true, Pulled(drive, tight.min_tension_N, table));
  Compensation::Result r = by_tension.Step(5, 0, true);
  EXPECT_EQ(r.tension_motor_N, 4);
  EXPECT_EQ(r.status, Status::kLimitedMotorTension);

  TendonDriveParameters weak = drive;
  weak.drive.current_limit_A = 0.1;
  Compensation by_torque(weak, robot.limits, true, Pulled(weak, robot.limits.min_tension_N, table));
  r = by_torque.Step(5, 0, true);
  EXPECT_NEAR(r.torque_Nm, 0.0196 * 0.1, 1e-15);
  EXPECT_EQ(r.status, Status::kLimitedTorque);

  EXPECT_EQ(Make(true).Step(5, 0, true).status, Status::kOk);
}

}  // namespace
}  // namespace tendril::control
