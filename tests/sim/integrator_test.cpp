// What the integrator does when CVODE gives up, and that it reaches the points it is asked for.
#include "../../src/sim/integrator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace tendril::sim {
namespace {

/// y' = -rate y, refusing `refusals` evaluations after `refuse_from`.
class Decay final : public OdeSystem {
 public:
  explicit Decay(double rate) : rate_(rate) {}
  bool Derivative(double t, const double* y, double* derivative) noexcept override {
    if (t > refuse_from && refusals > 0) {
      --refusals;
      return false;
    }
    derivative[0] = -rate_ * y[0];
    return true;
  }
  bool SolveNewton(double gamma, const double* b, double* x) noexcept override {
    x[0] = b[0] / (1 + gamma * rate_);
    return true;
  }
  double refuse_from = 1e300;
  int refusals = 0;

 private:
  double rate_;
};

Integrator::Tolerances Tight() { return {1e-9, Eigen::VectorXd::Constant(1, 1e-12)}; }

void ReachTo(Integrator& integrator, double end) {
  while (integrator.t() < end) integrator.StepTowards(end);
}

TEST(Integrator, ReachesEachEndExactlyWithTheSolutionThere) {
  Decay decay(3);
  Integrator integrator(decay, Eigen::VectorXd::Ones(1), Tight(), 1);
  for (int i = 1; i <= 100; ++i) {
    const double end = 0.01 * i;
    ReachTo(integrator, end);
    EXPECT_EQ(integrator.t(), end);
    EXPECT_NEAR(integrator.y()[0], std::exp(-3 * end), 1e-7);
  }
  EXPECT_EQ(integrator.counters().restarts, 0);
}

TEST(Integrator, StepsAreNoLongerThanAsked) {
  Decay decay(0.001);
  Integrator integrator(decay, Eigen::VectorXd::Ones(1), Tight(), 0.5e-3);
  ReachTo(integrator, 0.1);
  EXPECT_GE(integrator.counters().steps, 200);
  EXPECT_LT(integrator.counters().steps, 260);
}

TEST(Integrator, AStepGivenUpIsTriedAgainFromTheLastAcceptedPoint) {
  Decay decay(3);
  Integrator integrator(decay, Eigen::VectorXd::Ones(1), Tight(), 1);
  ReachTo(integrator, 0.5);
  decay.refuse_from = 0.5;
  decay.refusals = 25;  // more than CVODE's own ten attempts
  ReachTo(integrator, 1);
  EXPECT_GE(integrator.counters().restarts, 1);
  EXPECT_NEAR(integrator.y()[0], std::exp(-3), 1e-7);
}

TEST(Integrator, WhatNeverWorksEndsWithTheTimeAndTheReason) {
  Decay decay(3);
  Integrator integrator(decay, Eigen::VectorXd::Ones(1), Tight(), 1);
  ReachTo(integrator, 0.5);
  decay.refuse_from = 0.5;
  decay.refusals = 1'000'000;
  EXPECT_THAT([&] { ReachTo(integrator, 1); }, testing::ThrowsMessage<std::runtime_error>(
                                                   testing::HasSubstr("integration stopped at t = 0.5000")));
  EXPECT_LT(decay.refusals, 1'000'000 - 30);
}

}  // namespace
}  // namespace tendril::sim
