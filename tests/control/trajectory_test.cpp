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
constexpr double kDt = 1e-3, kMaxBending_rad = 2.6;

BendingVector V(double u, double v) {
  BendingVector b(2);
  b << u, v;
  return b;
}

TEST(Trajectory, KeepsAllLimitsUnderRandomTargets) {
  Trajectory t(2, kLimits, kMaxBending_rad, kNsPerMs);
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
  Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
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
  Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
  for (int i = 0; i < 4000; ++i) {
    t.Advance(V(0.8, 0.6), V(0, 0), 0.5);
    const auto& p = t.reference().position_rad;
    EXPECT_NEAR(p[0] * 0.6, p[1] * 0.8, 1e-12);
  }
  EXPECT_NEAR((t.reference().position_rad - V(0.8, 0.6)).norm(), 0, 1e-12);
  EXPECT_EQ(t.reference().velocity_radps.norm(), 0);
}

// Least times from rest to rest within kLimits and the speed asked for, from an independent source: ruckig
// 0.19.4 (PyPI), one degree of freedom.
TEST(Trajectory, IsNeverLaterThanItsWindowsBehindTheLeastTimeAndNeverTurnsBack) {
  struct Move {
    double way_rad, speed_radps, least_s;
  };
  for (const Move& move :
       {Move{1, 0.5, 2.031622777}, Move{0.1, 0.5, 0.231622777}, Move{0.01, 0.5, 0.054288352},
        Move{1, 2, 0.57}, Move{0.1, 2, 0.121980390}, Move{0.01, 2, 0.054288352}}) {
    Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
    const BendingVector direction = V(0.6, -0.8), goal = move.way_rad * direction;
    double arrived_s = 0, last = 0, fastest = 0;
    for (int i = 1; i < 4000; ++i) {
      t.Advance(goal, V(0, 0), move.speed_radps);
      const auto& r = t.reference();
      const double along = direction.dot(r.position_rad);
      EXPECT_GE(along, last - 1e-12) << "turned back";
      EXPECT_LE(along, move.way_rad + 1e-12) << "overshot";
      if (move.way_rad - along > 1e-9 || r.velocity_radps.norm() > 1e-9) arrived_s = (i + 1) * kDt;
      fastest = std::max(fastest, r.velocity_radps.norm());
      last = along;
    }
    EXPECT_LE(fastest, move.speed_radps * (1 + 1e-9)) << "the speed asked for holds as a limit does";
    EXPECT_GE(arrived_s, move.least_s - kDt);
    // Both windows: 2 v / a and 2 a / j, less a sample each.
    EXPECT_LE(arrived_s, move.least_s + 0.1 + 0.04);
    RecordProperty("ratio_" + std::to_string(move.way_rad) + "_at_" + std::to_string(move.speed_radps),
                   std::to_string(arrived_s / move.least_s));
  }
}

TEST(Trajectory, ATargetThatTurnsRoundAtFullRateIsCaughtUpWithinTheLimits) {
  Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
  BendingVector last_acceleration = V(0, 0);
  t.Reset(V(-1, 0));
  for (int i = 0; i < 6000; ++i) {
    // A triangle wave of +-1 rad at the limit of rate.
    const double phase = std::fmod(i * kDt, 2.0), at = phase < 1 ? 2 * phase - 1 : 3 - 2 * phase;
    t.Advance(V(at, 0), V(phase < 1 ? 2 : -2, 0), 0.5);
    const auto& r = t.reference();
    EXPECT_LE(r.velocity_radps.norm(), kLimits.max_rate_radps * (1 + 1e-9));
    EXPECT_LE(r.acceleration_radps2.norm(), kLimits.max_acceleration_radps2 * (1 + 1e-9));
    EXPECT_LE((r.acceleration_radps2 - last_acceleration).norm() / kDt, kLimits.max_jerk_radps3 * (1 + 1e-6));
    EXPECT_LE(std::abs(r.position_rad[0]), 1 + 1e-9);
    last_acceleration = r.acceleration_radps2;
    // Away from the corners it is where the target was one delay ago.
    const double since = std::fmod(phase, 1.0);
    if (i > 2500 && since > 0.2 && since < 0.95) {
      const double then = at - (phase < 1 ? 2 : -2) * ToSeconds(t.delay_ns());
      EXPECT_NEAR(r.position_rad[0], then, 2e-3) << i;
    }
  }
}

TEST(Trajectory, FollowsACircleSeenOneDelayAheadWithoutLag) {
  Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
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

// A target that comes out from behind: without a bound it would take the robot along, as fast as it moves
// itself.
TEST(Trajectory, AMovingTargetThatIsBehindLeadsNoSectionBeyondItsLimit) {
  Trajectory t(2, kLimits, kMaxBending_rad, kNsPerMs);
  BendingVector from(4), rate(4);
  from << 2.5, 0.3, 0, -2.55;
  rate << 1.5, 0, 0, -1;
  t.Reset(from);
  double most = 0;
  for (int i = 0; i < 2000; ++i) {
    BendingVector goal = 0.8 * from + std::min(i * kDt, 0.35) * rate;
    t.Advance(goal, i * kDt < 0.35 ? rate : BendingVector::Zero(4).eval(), 0.5);
    for (int k = 0; k < 2; ++k) most = std::max(most, t.reference().position_rad.segment<2>(2 * k).norm());
  }
  EXPECT_LE(most, kMaxBending_rad * (1 + 1e-12));
  EXPECT_GT(most, 2.55) << "the case is what it is meant to be";
}

TEST(Trajectory, BeyondItsLimitItGoesNoFurtherAndComesBackAtItsRate) {
  Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
  t.Reset(V(2.8, 0));  // where tension commands left the robot
  double last = 2.8;
  for (int i = 0; i < 4000; ++i) {
    t.Advance(V(2, 0), V(0, 0), 0.5);
    const double now = t.reference().position_rad[0];
    EXPECT_LE(now, last + 1e-12);
    EXPECT_GE(now, last - 0.5 * kDt * (1 + 1e-9));
    last = now;
  }
  EXPECT_NEAR(last, 2, 1e-12);
}

TEST(Trajectory, SaysWhenTheTargetIsTooFast) {
  Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
  EXPECT_EQ(t.Advance(V(0.01, 0), V(5, 0), 1), Status::kLimitedBendingRate);
}

TEST(Trajectory, ComesToRestWithinItsWindows) {
  Trajectory t(1, kLimits, kMaxBending_rad, kNsPerMs);
  for (int i = 0; i < 500; ++i) t.Advance(V(2, 0), V(0, 0), 1.9);
  for (int i = 0; i < 141; ++i) t.AdvanceToRest();
  EXPECT_EQ(t.reference().velocity_radps.norm(), 0);
  EXPECT_EQ(t.reference().acceleration_radps2.norm(), 0);
}

}  // namespace
}  // namespace tendril::control
