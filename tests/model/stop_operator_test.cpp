// Pre-sliding: rate independence, closed loops, Masing's rule, memory wiped out by larger swings, and Dahl's
// law against its differential equation.
#include "tendril/model/stop_operator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace tendril::model {
namespace {

constexpr double kPresliding_m = 5e-5;

TEST(StopOperators, SlidingInOneDirectionIsPlusOrMinusOne) {
  auto z = PulleyPresliding(kPresliding_m);
  EXPECT_EQ(z.Peek(0), 0);
  EXPECT_EQ(z.Commit(kPresliding_m), 1);
  EXPECT_EQ(z.Commit(1), 1);
  EXPECT_NEAR(z.Commit(1 - 2 * kPresliding_m), -1, 1e-12);
  EXPECT_EQ(z.Commit(-1), -1);
  z.Reset(3);
  EXPECT_EQ(z.Peek(3), 0);
}

TEST(StopOperators, VirginCurveIsTheSumOfItsElements) {
  auto z = PulleyPresliding(4);  // yields 1, 2, 3, 4
  EXPECT_DOUBLE_EQ(z.Peek(1), (1 + 1.0 / 2 + 1.0 / 3 + 1.0 / 4) / 4);
  EXPECT_DOUBLE_EQ(z.Peek(2.5), (1 + 1 + 2.5 / 3 + 2.5 / 4) / 4);
  EXPECT_DOUBLE_EQ(z.Peek(-2.5), -(1 + 1 + 2.5 / 3 + 2.5 / 4) / 4);
}

// However often the memory is moved along a monotone stretch, and however fast, the outcome is the same.
TEST(StopOperators, RateIndependent) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-2 * kPresliding_m, 2 * kPresliding_m);
  auto coarse = PulleyPresliding(kPresliding_m), fine = coarse, peeked = coarse;
  double x = 0;
  for (int turn = 0; turn < 200; ++turn) {
    const double next = uniform(random);
    for (int i = 1; i <= 37; ++i) {
      const double at = x + (next - x) * i / 37;
      peeked.Peek(at);
      EXPECT_NEAR(fine.Commit(at), coarse.Peek(at), 1e-12);
    }
    EXPECT_NEAR(coarse.Commit(next), fine.Peek(next), 1e-12);
    EXPECT_NEAR(peeked.Commit(next), coarse.Peek(next), 1e-12) << "looking does not move the memory";
    x = next;
  }
}

TEST(StopOperators, LoopsCloseAndFollowMasing) {
  for (double amplitude : {0.2, 0.5, 0.8, 1.7}) {
    const double a = amplitude * kPresliding_m;
    auto z = PulleyPresliding(kPresliding_m);
    const auto virgin = PulleyPresliding(kPresliding_m);
    const double top = z.Commit(a);
    const double bottom = z.Commit(-a);
    EXPECT_NEAR(bottom, -top, 1e-12);
    // Masing: after a reversal the curve is the virgin one, twice as large.
    for (int i = 0; i <= 20; ++i) {
      const double x = -a + 2 * a * i / 20;
      EXPECT_NEAR(z.Peek(x), bottom + 2 * virgin.Peek((x + a) / 2), 1e-12);
    }
    EXPECT_NEAR(z.Commit(a), top, 1e-12) << "the loop closes";
    // A small loop inside leaves no trace.
    z.Commit(0.4 * a);
    z.Commit(0.7 * a);
    z.Commit(0.4 * a);
    auto plain = PulleyPresliding(kPresliding_m);
    plain.Commit(a);
    plain.Commit(-a);
    plain.Commit(a);
    for (double x : {0.3 * a, -0.2 * a, -a}) EXPECT_NEAR(z.Peek(x), plain.Peek(x), 1e-12);
  }
}

TEST(StopOperators, EveryLoopTakesEnergy) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(0.1, 2);
  for (int loop = 0; loop < 20; ++loop) {
    auto z = PulleyPresliding(kPresliding_m);
    const double a = uniform(random) * kPresliding_m;
    z.Commit(a);
    double work = 0;
    for (int i = 1; i <= 2000; ++i) {
      const double before = a * std::cos(2 * std::numbers::pi * (i - 1) / 2000),
                   after = a * std::cos(2 * std::numbers::pi * i / 2000);
      const double z_before = z.Peek(before);
      work += 0.5 * (z_before + z.Commit(after)) * (after - before);
    }
    EXPECT_GE(work, -1e-18);
  }
}

TEST(StopOperators, YieldsMustBePositive) {
  EXPECT_THROW(StopOperators<2>({0.1, 0.0}), std::invalid_argument);
  EXPECT_THROW(StopOperators<1>({std::nan("")}), std::invalid_argument);
  EXPECT_THROW(PulleyPresliding(0), std::invalid_argument);
  EXPECT_THROW(DahlState(0), std::invalid_argument);
  EXPECT_EQ(StopOperators<3>().Peek(5), 0) << "without yields it never takes hold";
}

TEST(Dahl, ClosedFormSolvesItsEquation) {
  constexpr double kAngle = 0.004;
  DahlState state(kAngle);
  double zeta = 0, x = 0;
  const double dt = 1e-5;
  const auto speed = [](double t) { return 1.3 * std::sin(9 * t) + 0.4 * std::sin(41 * t + 1); };
  const auto slope = [&](double t, double value) {
    const double w = speed(t);
    return (w - std::abs(w) * value) / kAngle;
  };
  double worst = 0;
  for (int i = 0; i < 100000; ++i) {
    const double t = i * dt;
    const double k1 = slope(t, zeta), k2 = slope(t + dt / 2, zeta + dt / 2 * k1);
    const double k3 = slope(t + dt / 2, zeta + dt / 2 * k2), k4 = slope(t + dt, zeta + dt * k3);
    zeta += dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    x += dt / 6 * (speed(t) + 4 * speed(t + dt / 2) + speed(t + dt));
    worst = std::max(worst, std::abs(state.Commit(x) - zeta));
  }
  // The last step before a reversal is not monotone: that is all that separates the two.
  EXPECT_LT(worst, 2e-5);
}

TEST(Dahl, RateIndependentAndBounded) {
  DahlState coarse(0.004), fine(0.004);
  double x = 0;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-0.02, 0.02);
  for (int turn = 0; turn < 100; ++turn) {
    const double next = uniform(random);
    for (int i = 1; i <= 10; ++i) fine.Commit(x + (next - x) * i / 10);
    EXPECT_NEAR(coarse.Commit(next), fine.Peek(next), 1e-12);
    EXPECT_LE(std::abs(coarse.Peek(next)), 1);
    x = next;
  }
  coarse.Reset(0);
  EXPECT_NEAR(coarse.Commit(1), 1, 1e-12);
}

}  // namespace
}  // namespace tendril::model
