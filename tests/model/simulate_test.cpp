// Motion integrated by CVODE against another integrator, the equilibrium it ends at, knots and the output
// grid.
#include "tendril/model/simulate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "bodies.h"
#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

struct Motion {
  std::vector<double> t;
  std::vector<VectorXd> q, dq;
};

Motion Integrate(const Body& body, const TensionProfile& profile, const VectorXd& q, const VectorXd& dq,
                 double step_s, double rtol) {
  Motion motion;
  Simulate(body, profile, q, dq, step_s, rtol, [&](double t, ConstVectorRef at, ConstVectorRef speed) {
    motion.t.push_back(t);
    motion.q.emplace_back(at);
    motion.dq.emplace_back(speed);
  });
  return motion;
}

TensionProfile Constant(const VectorXd& tension, double end_s) {
  return {Vector2d(0, end_s), tension.replicate(1, 2)};
}

// Classic Runge-Kutta with a step so small that its error does not count, over tensions with a corner.
void CheckAgainstRungeKutta(const BodyParameters& parameters) {
  const Body body(parameters);
  Body::Workspace workspace(body);
  const int n = body.dof(), m = body.tendons();
  test::Random random(3);
  TensionProfile profile{Eigen::Vector3d(1.0, 1.013, 1.02), MatrixXd(m, 3)};
  for (int k = 0; k < 3; ++k) profile.tension_N.col(k) = random.Vector(m, 0.3, 3);
  VectorXd q = random.Vector(n, -0.2, 0.2), dq = random.Vector(n, -1, 1);
  const Motion motion = Integrate(body, profile, q, dq, 0.005, 1e-11);
  ASSERT_EQ(motion.t.size(), 5u);
  EXPECT_NEAR(motion.t.back(), 1.02, 1e-15);

  const auto accelerate = [&](double t, const VectorXd& at, const VectorXd& speed) {
    const int k = t < 1.013 ? 0 : 1;
    const double share = (t - profile.time_s[k]) / (profile.time_s[k + 1] - profile.time_s[k]);
    VectorXd force(n), ddq(n);
    body.TendonForce(at, (1 - share) * profile.tension_N.col(k) + share * profile.tension_N.col(k + 1),
                     force);
    body.ForwardDynamics(at, speed, force, ddq, workspace);
    return ddq;
  };
  const int steps = 20000;
  const double h = 0.02 / steps;  // the corner falls on a step
  for (int i = 0; i < steps; ++i) {
    const double t = 1 + i * h;
    // The last stage belongs to the piece of its step.
    const double end = i + 1 == 13000 ? std::nextafter(1.013, 0) : t + h;
    const VectorXd a1 = accelerate(t, q, dq), v1 = dq;
    const VectorXd v2 = dq + h / 2 * a1, a2 = accelerate(t + h / 2, q + h / 2 * v1, v2);
    const VectorXd v3 = dq + h / 2 * a2, a3 = accelerate(t + h / 2, q + h / 2 * v2, v3);
    const VectorXd v4 = dq + h * a3, a4 = accelerate(end, q + h * v3, v4);
    q += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
    dq += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  }
  EXPECT_LT((motion.q.back() - q).norm(), 1e-8 * q.norm());
  EXPECT_LT((motion.dq.back() - dq).norm(), 1e-8 * dq.norm());
}

TEST(Simulate, AgreesWithRungeKuttaWithoutDamping) { CheckAgainstRungeKutta(test::PaperBody()); }

TEST(Simulate, AgreesWithRungeKuttaWithDamping) { CheckAgainstRungeKutta(test::TwoSections()); }

TEST(Simulate, DampedMotionEndsAtTheStaticEquilibrium) {
  BodyParameters parameters = test::PaperBody();
  parameters.sections[0].bending_damping_Nms = 2e-4;
  const Body body(parameters);
  const Eigen::Vector3d tension(5, 0.3, 0.3);
  const Motion motion =
      Integrate(body, Constant(tension, 10), VectorXd::Zero(8), VectorXd::Zero(8), 10, 1e-10);
  const Equilibrium rest = SolveStatics(body, tension, Eigen::Vector3d::Zero());
  EXPECT_LT((motion.q.back() - rest.q).norm(), 1e-8);
}

TEST(Simulate, AKnotOnTheLineChangesNothing) {
  const Body body(test::PaperBody());
  TensionProfile two{Vector2d(0, 0.04), MatrixXd(3, 2)},
      three{Eigen::Vector3d(0, 0.03, 0.04), MatrixXd(3, 3)};
  two.tension_N << 1, 5, 1, 1, 1, 3;
  three.tension_N << 1, 4, 5, 1, 1, 1, 1, 2.5, 3;
  const VectorXd q = VectorXd::Zero(8);
  const Motion a = Integrate(body, two, q, q, 0.01, 1e-11), b = Integrate(body, three, q, q, 0.01, 1e-11);
  EXPECT_LT((a.q.back() - b.q.back()).norm(), 1e-9);
}

TEST(Simulate, SamplesTheGridFromTheFirstKnotToTheLast) {
  const Body body(test::PaperBody());
  const VectorXd q = VectorXd::Zero(8);
  TensionProfile profile{Vector2d(0.2, 0.3), MatrixXd::Ones(3, 2)};
  const Motion whole = Integrate(body, profile, q, q, 0.01, 1e-6);
  ASSERT_EQ(whole.t.size(), 11u);  // 0.1 / 0.01 is a little less than 10 in doubles
  EXPECT_EQ(whole.t.front(), 0.2);
  EXPECT_EQ(whole.t.back(), 0.3);
  EXPECT_EQ(Integrate(body, profile, q, q, 0.03, 1e-6).t.size(), 4u);
  profile = {VectorXd::Constant(1, 7.0), MatrixXd::Ones(3, 1)};
  EXPECT_EQ(Integrate(body, profile, q, q, 0.01, 1e-6).t, std::vector<double>{7.0});
}

TEST(Simulate, RefusesWhatMakesNoSense) {
  const Body body(test::PaperBody());
  const VectorXd q = VectorXd::Zero(8);
  const TensionProfile good = Constant(VectorXd::Ones(3), 0.1);
  TensionProfile bad = good;
  bad.time_s[1] = 0;
  EXPECT_THROW(Integrate(body, bad, q, q, 0.01, 1e-9), std::invalid_argument);
  bad = good;
  bad.tension_N(0, 1) = std::numeric_limits<double>::infinity();
  EXPECT_THROW(Integrate(body, bad, q, q, 0.01, 1e-9), std::invalid_argument);
  EXPECT_THROW(Integrate(body, good, VectorXd::Zero(6), q, 0.01, 1e-9), std::invalid_argument);
  EXPECT_THROW(Integrate(body, good, q, q, 0, 1e-9), std::invalid_argument);
  EXPECT_THROW(Integrate(body, good, q, q, 0.01, 1e-20), std::invalid_argument);
}

}  // namespace
}  // namespace tendril::model
