// One drivetrain by itself: its parts agree with the whole, copies part ways, and the laws of effects do what
// their equations say.
#include "../../src/sim/drivetrain.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "../../src/sim/laws.h"
#include "../support/allocation_count.h"
#include "motions.h"
#include "tendril/sim/effects.h"

namespace tendril::sim {
namespace {

class DrivetrainTest : public testing::Test {
 protected:
  static constexpr double kStart_N = 0.3;
  DrivetrainTest() : robot(test::Rig()), p(robot.actuation->tendons[0]) {
    capstan = std::make_shared<model::CapstanTable>(p.transmission, 20);
  }

  Drivetrain Make(const TendonLaws& laws = {}) const { return {p, kStart_N, capstan, laws}; }

  /// All laws of tendons at typical values.
  TendonLaws Everything() const {
    RobotParameters real = robot;
    for (const Effect& effect : Effects()) {
      if (effect.scope != Scope::kTendon || !effect.add) continue;
      EffectSetting setting{std::string(effect.name), "all", {}};
      for (const auto& q : effect.parameters) setting.values.emplace_back(q.name, q.nominal + q.typical);
      real.effects.push_back(setting);
    }
    return PlantLaws::Of(real).tendon[0];
  }

  /// Back and forth, with the body following.
  static DrivetrainMotion MotionAt(double t) {
    const double w = 2 * std::numbers::pi * 3;
    const double angle = 4 * std::sin(w * t), rate = 4 * w * std::cos(w * t);
    return {angle, rate, 4.2e-4 * 0.8 * angle, 4.2e-4 * 0.8 * rate};
  }

  RobotParameters robot;
  TendonDriveParameters& p;
  std::shared_ptr<const model::CapstanTable> capstan;
};

// Replay puts the chain together from these.
TEST_F(DrivetrainTest, PartsAgreeWithTheWhole) {
  p.motor.torque_scale = 1.2;
  p.transmission.coulomb_N = 0.1;
  for (const TendonLaws& laws : {TendonLaws{}, Everything()}) {
    Drivetrain d = Make(laws);
    double most_N = 0;
    for (int i = 1; i < 1000; ++i) {
      const double t = i * 5e-4;
      d.SetTorque(t - 5e-4, 1e-3 * std::sin(40 * t));
      const DrivetrainMotion motion = MotionAt(t);
      const DrivetrainForces f = d.Evaluate(t, motion);
      EXPECT_EQ(d.TensionFromStretch(t, motion), f.tension_motor_N);
      EXPECT_EQ(d.BaseTension(t, motion, f.tension_motor_N), f.tension_base_N);
      EXPECT_NEAR(d.TensionFromTorque(t, motion, d.Torque(t), f.acceleration_radps2), f.tension_motor_N,
                  1e-11);
      most_N = std::max(most_N, f.tension_motor_N);
      d.Commit(t, motion);
    }
    EXPECT_GT(most_N, 2);
  }
}

TEST_F(DrivetrainTest, ACopyGoesItsOwnWay) {
  Drivetrain a = Make(Everything());
  for (int i = 1; i < 300; ++i) a.Commit(i * 5e-4, MotionAt(i * 5e-4));
  Drivetrain b = a;
  const DrivetrainMotion motion = MotionAt(0.15);
  const double before = b.Evaluate(0.15, motion).tension_base_N;
  for (int i = 300; i < 1000; ++i) a.Commit(i * 5e-4, MotionAt(i * 5e-4));
  EXPECT_EQ(b.Evaluate(0.15, motion).tension_base_N, before);
  for (int i = 300; i < 1000; ++i) b.Commit(i * 5e-4, MotionAt(i * 5e-4));
  EXPECT_EQ(b.Evaluate(0.5, MotionAt(0.5)).tension_base_N, a.Evaluate(0.5, MotionAt(0.5)).tension_base_N);
}

TEST_F(DrivetrainTest, EvaluatingAndCommittingAllocateNothing) {
  Drivetrain d = Make(Everything());
  d.SetTorque(0, 1e-3);
  const auto before = test::AllocationCount();
  for (int i = 1; i < 100; ++i) {
    const DrivetrainMotion motion = MotionAt(i * 5e-4);
    const DrivetrainForces f = d.Evaluate(i * 5e-4, motion);
    d.Linearise(motion, f, 1e-4);
    d.TensionFromTorque(i * 5e-4, motion, 1e-3, 0);
    d.BaseTension(i * 5e-4, motion, f.tension_motor_N);
    d.Commit(i * 5e-4, motion);
  }
  EXPECT_EQ(test::AllocationCount(), before);
}

TEST(TorqueLoop, DelaysThenLagsThenClips) {
  const double lag = 0.7e-3, delay = 2.3e-3, limit = 1.5e-3;
  TorqueLoop loop(1e-4, lag, delay, limit);
  loop.Set(0, 1e-3);
  loop.Set(1e-3, 9e-3);
  loop.Set(2e-3, 0);
  const auto decay = [&](double s) { return std::exp(-s / lag); };
  EXPECT_EQ(loop.At(2.2e-3), 1e-4);
  EXPECT_EQ(loop.NextCorner(2e-3), 2.3e-3);
  const double first = 1e-3 + (1e-4 - 1e-3) * decay(1e-3);
  EXPECT_NEAR(loop.At(3.3e-3), first, 1e-18);
  EXPECT_NEAR(loop.At(3.8e-3), limit + (first - limit) * decay(0.5e-3), 1e-18);
  const double second = limit + (first - limit) * decay(1e-3);
  EXPECT_NEAR(loop.At(6.3e-3), second * decay(2e-3), 1e-18);
  loop.Set(7e-3, 0);  // forgets what has acted, changes nothing
  EXPECT_NEAR(loop.At(7e-3), second * decay(2.7e-3), 1e-18);
  EXPECT_EQ(loop.NextCorner(9.4e-3), std::numeric_limits<double>::infinity());
}

TEST_F(DrivetrainTest, PlayHoldsTheSpoolAfterAReversal) {
  Drivetrain d = Make({.play_rad = 0.1});
  const auto pull = [&](double angle, double velocity) {
    static double t = 0;
    t += 5e-4;
    const DrivetrainMotion motion{angle, velocity, 0, 0};
    const double s = d.Evaluate(t, motion).spool_pull_m;
    d.Commit(t, motion);
    return s / p.SpoolTravelPerMotorRad();
  };
  EXPECT_NEAR(pull(0.02, 1), 0.02, 1e-15);  // taken up in the pulling direction at the start
  EXPECT_NEAR(pull(0.05, 1), 0.05, 1e-15);
  EXPECT_NEAR(pull(-0.04, -1), 0.05, 1e-3);  // through the turning point on the way
  EXPECT_NEAR(pull(-0.06, -1), 0.04, 1e-15);
  EXPECT_NEAR(pull(-0.02, 1), 0.04, 1e-3);
  EXPECT_NEAR(pull(0.06, 1), 0.06, 1e-15);
}

TEST_F(DrivetrainTest, SpoolGrowsWithWhatItWinds) {
  const double growth = 2e-4;
  const Drivetrain d = Make({.spool_growth_mprad = growth});
  for (const double angle : {-8.0, 3.0, 12.0}) {
    const double phi = angle / p.gear.ratio, r = p.spool.radius_m;
    const DrivetrainForces f = d.Evaluate(5e-4, {angle, 2.0, 0, 0});
    EXPECT_NEAR(f.spool_pull_m, r * phi + growth * phi * phi / 2, 1e-15);
    EXPECT_NEAR(f.load_arm_m, (r + growth * phi) / p.gear.ratio, 1e-15);
    EXPECT_EQ(f.pull_m_per_rad, f.load_arm_m);
  }
}

TEST_F(DrivetrainTest, CreepIsAStandardLinearSolid) {
  RobotParameters real = robot;
  real.effects = {{"tendon_creep", "all", {{"fraction", 0.25}, {"tau_s", 0.5}}}};
  Drivetrain d = Make(PlantLaws::Of(real).tendon[0]);
  // A step of stretch that is held: k stiff, k / 1.25 in the end, and relaxing with tau / 1.25 between.
  const double stretch = 1e-4, k = p.tendon.stiffness_Npm;
  const DrivetrainMotion held{stretch / p.SpoolTravelPerMotorRad(), 0, 0, 0};
  for (int i = 0; i <= 4000; ++i) {
    const double t = i * 5e-4;
    const double step = k * stretch;
    const double expected = kStart_N + step * (0.8 + 0.2 * std::exp(-t / 0.4));
    EXPECT_NEAR(d.TensionFromStretch(t, held), expected, 2e-3 * step * 0.2);
    d.Commit(t, held);
  }
}

TEST_F(DrivetrainTest, ASlackTendonPullsOnceItIsTaut) {
  const Drivetrain d = Make({.slack_m = 2e-4});
  const double travel = p.SpoolTravelPerMotorRad(), k = p.tendon.stiffness_Npm;
  EXPECT_EQ(d.TensionFromStretch(0, {}), 0);
  const double taut = (2e-4 - kStart_N / k) / travel;
  EXPECT_EQ(d.TensionFromStretch(0, {0.99 * taut, 0, 0, 0}), 0);
  EXPECT_NEAR(d.TensionFromStretch(0, {taut + 1e-4 / travel, 0, 0, 0}), 1e-4 * k, 1e-9);
}

TEST_F(DrivetrainTest, BearingsTakeTheSameAtEveryLoadAndNothingFromASlackTendon) {
  const Drivetrain plain = Make();
  p.transmission.coulomb_N = 0.2;
  for (const double direction : {1.0, -1.0}) {
    Drivetrain a = plain, b = Make();
    const DrivetrainMotion slid{direction, 0, 0, 0};  // 0.2 mm at the pulley: friction fully built up
    a.Commit(5e-4, slid);
    b.Commit(5e-4, slid);
    for (const double tension : {1.0, 2.0, 8.0}) {
      EXPECT_NEAR(a.BaseTension(1e-3, slid, tension) - b.BaseTension(1e-3, slid, tension), 0.2 * direction,
                  1e-12);
    }
    EXPECT_EQ(b.BaseTension(1e-3, slid, 0), 0);
  }
}

}  // namespace
}  // namespace tendril::sim
