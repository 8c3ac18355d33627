// Whatever target comes in, the reference keeps rate, acceleration and jerk limits, is consistent with its
// own derivatives, arrives exactly, and follows a moving target looked at one delay ahead.
#include "tendril/control/trajectory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace tendril::control {
namespace {

constexpr TrajectoryParameters kLimits{
    .default_speed_radps = 0.5, .max_rate_radps = 2, .max_acceleration_radps2 = 40, .max_jerk_radps3 = 2000};
constexpr double kDt = 1e-3;

BendingVector V(double u, double v) {
  BendingVector b(2);
  b << u, v;
  return b;
}

TEST(Trajectory, KeepsAllLimitsUnderRandomTargets) {
  Trajectory t(2, kLimits, kNsPerMs);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> angle(-2, 2), rate(-3, 3), speed(0.1, 5);
  BendingVector goal = BendingVector::Zero(4), goal_rate = goal, last_acceleration = goal;
  double s = 1;
  for (int i = 0; i < 20000; ++i) {
    if (i % 37 == 0) {
      for (int k = 0; k < 4; ++k) {
        goal[k] = angle(random);
        goal_rate[k] = i % 2 ? rate(random) : 0;
      }
      s = speed(random);
    }
    t.Advance(goal, goal_rate, s);
    const auto& r = t.reference();
    for (int k = 0; k < 2; ++k) {
      EXPECT_LE(r.velocity_radps.segment<2>(2 * k).norm(), kLimits.max_rate_radps * (1 + 1e-9));
      EXPECT_LE(r.acceleration_radps2.segment<2>(2 * k).norm(), kLimits.max_acceleration_radps2 * (1 + 1e-9));
      const double jerk = (r.acceleration_radps2 - last_acceleration).segment<2>(2 * k).norm() / kDt;
      EXPECT_LE(jerk, kLimits.max_jerk_radps3 * (1 + 1e-6));
    }
    last_acceleration = r.acceleration_radps2;
  }
}

TEST(Trajectory, DerivativesBelongToThePosition) {
  Trajectory t(1, kLimits, kNsPerMs);
  BendingVector p = t.reference().position_rad, v = t.reference().velocity_radps;
  for (int i = 0; i < 3000; ++i) {
    t.Advance(i < 1500 ? V(1, -0.5) : V(-0.3, 0.2), V(0, 0), 1.5);
    const auto& r = t.reference();
    EXPECT_LT(((r.position_rad - p) / kDt - r.velocity_radps).norm(), 1e-10);
    EXPECT_LT(((r.velocity_radps - v) / kDt - r.acceleration_radps2).norm(), 1e-7);
    p = r.position_rad;
    v = r.velocity_radps;
  }
}

TEST(Trajectory, ArrivesExactlyOnAStraightLine) {
  Trajectory t(1, kLimits, kNsPerMs);
  for (int i = 0; i < 4000; ++i) {
    t.Advance(V(0.8, 0.6), V(0, 0), 0.5);
    const auto& p = t.reference().position_rad;
    EXPECT_NEAR(p[0] * 0.6, p[1] * 0.8, 1e-12);
  }
  EXPECT_NEAR((t.reference().position_rad - V(0.8, 0.6)).norm(), 0, 1e-12);
  EXPECT_EQ(t.reference().velocity_radps.norm(), 0);
}

TEST(Trajectory, FollowsACircleSeenOneDelayAheadWithoutLag) {
  Trajectory t(1, kLimits, kNsPerMs);
  const double radius = std::numbers::pi / 3, omega = std::numbers::pi / 6;
  const double delay = ToSeconds(t.delay_ns());
  double worst = 0;
  for (int i = 0; i < 12000; ++i) {
    const double now = i * kDt, ahead = now + delay;
    const BendingVector goal = radius * V(std::cos(omega * ahead), std::sin(omega * ahead));
    const BendingVector rate = radius * omega * V(-std::sin(omega * ahead), std::cos(omega * ahead));
    EXPECT_EQ(t.Advance(goal, rate, 0.5), Status::kOk);
    if (i > 6000) {
      worst = std::max(
          worst,
          (t.reference().position_rad - radius * V(std::cos(omega * now), std::sin(omega * now))).norm());
    }
  }
  // What the two averages take off a circle: omega^2 (w1^2 + w2^2) / 24 of its radius, windows of 0.1 and
  // 0.04 s.
  const double expected = radius * omega * omega * (0.1 * 0.1 + 0.04 * 0.04) / 24;
  EXPECT_NEAR(worst, expected, 0.1 * expected);
}

TEST(Trajectory, SaysWhenTheTargetIsTooFast) {
  Trajectory t(1, kLimits, kNsPerMs);
  EXPECT_EQ(t.Advance(V(0.01, 0), V(5, 0), 1), Status::kLimitedBendingRate);
}

TEST(Trajectory, ComesToRestWithinItsWindows) {
  Trajectory t(1, kLimits, kNsPerMs);
  for (int i = 0; i < 500; ++i) t.Advance(V(2, 0), V(0, 0), 1.9);
  for (int i = 0; i < 141; ++i) t.AdvanceToRest();
  EXPECT_EQ(t.reference().velocity_radps.norm(), 0);
  EXPECT_EQ(t.reference().acceleration_radps2.norm(), 0);
}

}  // namespace
}  // namespace tendril::control
