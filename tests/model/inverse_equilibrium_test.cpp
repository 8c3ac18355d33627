// Tensions from a desired bend or tip in true equilibrium: round trips through the statics solver (which
// knows nothing of this one), optimality by finite differences of it, targets out of reach against a grid.
#include "tendril/model/inverse_equilibrium.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <random>

#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using std::numbers::pi;

constexpr double kMinTension_N = 0.3, kMaxTension_N = 8;

SectionParameters SlenderSection(double unit_length_m, int tendons, double twist_rad, double damping = 0) {
  SectionParameters s;
  s.units = 4;
  s.unit_length_m = unit_length_m;
  s.unit_mass_kg = 0.0025;
  s.disk_inertia_xx_kgm2 = 1.5625e-8;
  s.disk_inertia_zz_kgm2 = 3.125e-8;
  s.youngs_modulus_Pa = 2.3e10;
  s.core_radius_m = 0.5e-3;
  s.bending_damping_Nms = damping;
  for (int j = 0; j < tendons; ++j) s.tendons.push_back({twist_rad + 2 * pi * j / tendons, 0.004});
  return s;
}

Body ThreeTendons() {
  BodyParameters p;
  p.sections = {SlenderSection(0.0225, 3, 0)};
  return Body(p);
}
Body FiveTendons() {
  BodyParameters p;
  p.sections = {SlenderSection(0.0225, 5, 0)};
  p.gravity_W_mps2 = {4, 3, -8.4};  // mounted at a slant: nothing is symmetric
  return Body(p);
}
Body TwoSections() {
  BodyParameters p;
  p.sections = {SlenderSection(0.015, 3, 0, 2e-4), SlenderSection(0.015, 3, pi / 3, 2e-4)};
  return Body(p);
}

/// Payload, a steady pull at the tip, twisted holes, units that are soft or bent by themselves.
Body AsBuilt() {
  BodyParameters p;
  p.sections = {SlenderSection(0.0225, 3, 0.2, 2e-4)};
  p.tip_payload_kg = 0.002;
  p.tip_force_W_N = {0.01, -0.02, 0};
  p.twist_rad_per_m = 3;
  p.unit_deviations = {{.unit = 2, .stiffness_scale = 0.85},
                       {.unit = 3, .rest_u_rad = 0.1, .rest_v_rad = -0.05}};
  return Body(p);
}

VectorXd RandomTensions(std::mt19937& random, int count, double most) {
  std::uniform_real_distribution<double> uniform(-0.6, 1);
  VectorXd t(count);
  for (double& v : t) v = std::max(kMinTension_N, most * uniform(random));
  return t;
}

VectorXd Sums(const Body& body, const VectorXd& q) {
  VectorXd sums(2 * body.sections());
  body.SumBending(q, sums);
  return sums;
}

double Effort(const VectorXd& t) { return (t.array() - kMinTension_N).matrix().squaredNorm(); }

/// First-order conditions of the least sum, with the slope of `goal` by each tension from the statics solver.
template <class Goal>
void ExpectOptimal(const Body& body, const TensionedShape& shape, Goal goal, double tolerance) {
  const int m = body.tendons();
  MatrixXd slope(goal(shape.q).size(), m);
  for (int j = 0; j < m; ++j) {
    const auto at = [&](double change) {
      const VectorXd t = shape.tension_N + change * VectorXd::Unit(m, j);
      return VectorXd(goal(SolveStaticsFrom(body, shape.q, t, Vector3d::Zero()).q));
    };
    slope.col(j) = (at(1e-4) - at(-1e-4)) / 2e-4;
  }
  // tension - least = slope^T y for the tendons in between; those at the minimum must not want to come off
  // it.
  std::vector<int> free;
  for (int j = 0; j < m; ++j) {
    if (shape.tension_N[j] > kMinTension_N + 1e-9 && shape.tension_N[j] < kMaxTension_N - 1e-9)
      free.push_back(j);
  }
  MatrixXd rows(free.size(), slope.rows());
  VectorXd above(free.size());
  for (std::size_t i = 0; i < free.size(); ++i) {
    rows.row(i) = slope.col(free[i]).transpose();
    above[i] = shape.tension_N[free[i]] - kMinTension_N;
  }
  SCOPED_TRACE(testing::Message() << shape.tension_N.transpose() << "\n" << slope);
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> inverse;
  inverse.setThreshold(1e-5);
  inverse.compute(rows);
  const VectorXd y = free.empty() ? VectorXd() : VectorXd(inverse.solve(above));
  if (!free.empty()) {
    EXPECT_LT((rows * y - above).norm(), tolerance * (1 + above.norm()));
  }
  if (free.empty() || inverse.rank() < slope.rows()) return;  // the multiplier is not unique
  for (int j = 0; j < m; ++j) {
    const double pull = slope.col(j).dot(y);
    if (shape.tension_N[j] <= kMinTension_N + 1e-9) {
      EXPECT_LT(pull, tolerance * (1 + above.norm()));
    }
    if (shape.tension_N[j] >= kMaxTension_N - 1e-9) {
      EXPECT_GT(pull, kMaxTension_N - kMinTension_N - tolerance * (1 + above.norm()));
    }
  }
}

TEST(InverseEquilibrium, BendingComesBackWithTheLeastTensions) {
  for (const Body& body : {ThreeTendons(), FiveTendons(), TwoSections(), AsBuilt()}) {
    std::mt19937 random(1);
    const InverseEquilibrium inverse(body, kMinTension_N, kMaxTension_N);
    int cases = 0;
    for (int i = 0; i < 40; ++i) {
      const VectorXd t = RandomTensions(random, body.tendons(), body.sections() == 1 ? 5.5 : 3.5);
      const Equilibrium at = SolveStatics(body, t, Vector3d::Zero());
      if (at.result != StaticsResult::kConverged) continue;
      ++cases;
      const VectorXd wanted = Sums(body, at.q);
      const TensionedShape shape = inverse.ForBending(wanted);
      ASSERT_EQ(shape.status, Status::kOk) << t.transpose();
      // Not less: the same sums to the last digit can need much more tension all round, which moves them by
      // nanoradians.
      EXPECT_LT(shape.target_error, 2e-8);
      EXPECT_LT(shape.residual_Nm, 1e-14);
      EXPECT_GE(shape.tension_N.minCoeff(), kMinTension_N);
      EXPECT_LE(Effort(shape.tension_N), Effort(t) * (1 + 1e-9) + 1e-12) << t.transpose();
      if (body.tendons() == 3 && t.minCoeff() == kMinTension_N) {
        EXPECT_LT((shape.tension_N - t).norm(), 1e-10);  // no others do it
      }
      const Equilibrium back = SolveStatics(body, shape.tension_N, Vector3d::Zero());
      EXPECT_NEAR((Sums(body, back.q) - wanted).norm(), shape.target_error, 1e-10);
      ExpectOptimal(
          body, shape, [&](const VectorXd& q) { return Sums(body, q); }, 1e-5);
    }
    EXPECT_GT(cases, 25);
  }
}

TEST(InverseEquilibrium, TipComesBackWithTheLeastTensions) {
  for (const Body& body : {ThreeTendons(), FiveTendons(), TwoSections(), AsBuilt()}) {
    std::mt19937 random(2);
    const InverseEquilibrium inverse(body, kMinTension_N, kMaxTension_N);
    int cases = 0, same_or_less = 0, other_face = 0;
    for (int i = 0; i < 40; ++i) {
      const VectorXd t = RandomTensions(random, body.tendons(), body.sections() == 1 ? 5.5 : 3.5);
      const Equilibrium at = SolveStatics(body, t, Vector3d::Zero());
      if (at.result != StaticsResult::kConverged) continue;
      ++cases;
      const Vector3d wanted = body.TipPose(at.q).p_WA;
      const TensionedShape shape = inverse.ForTip(wanted, 2.6);
      EXPECT_LT(shape.residual_Nm, 1e-14);
      // One section's tips form a shell not a micrometre thick: with more than three tendons the search may
      // end at its other face.
      if (shape.status == Status::kTargetUnreachable && body.sections() == 1 && body.tendons() > 3) {
        EXPECT_LT(shape.target_error, 1e-6);
        --cases;
        ++other_face;
        continue;
      }
      ASSERT_EQ(shape.status, Status::kOk) << t.transpose() << " miss " << shape.target_error;
      EXPECT_LT(shape.target_error, 1e-8);
      same_or_less += Effort(shape.tension_N) <= Effort(t) * (1 + 1e-6) + 1e-9;
      const Equilibrium back = SolveStatics(body, shape.tension_N, Vector3d::Zero());
      EXPECT_NEAR((body.TipPose(back.q).p_WA - wanted).norm(), shape.target_error, 1e-11);
      if (body.tendons() > 3) {
        ExpectOptimal(
            body, shape, [&](const VectorXd& q) { return VectorXd(body.TipPose(q).p_WA); }, 1e-4);
      }
    }
    EXPECT_GT(cases, 25);
    EXPECT_EQ(same_or_less, cases);
    EXPECT_LE(other_face, 1);
  }
}

TEST(InverseEquilibrium, OutOfReachGoesNearest) {
  const Body body = ThreeTendons();
  const double most = 2;
  const InverseEquilibrium inverse(body, kMinTension_N, most);
  for (double angle : {0.0, 0.4, pi / 3, 2.0, -1.3}) {
    const VectorXd wanted = 1.8 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    const TensionedShape shape = inverse.ForBending(wanted);
    EXPECT_EQ(shape.status, Status::kTargetUnreachable);
    EXPECT_GE(shape.tension_N.minCoeff(), kMinTension_N);
    EXPECT_LE(shape.tension_N.maxCoeff(), most * (1 + 1e-15));
    double nearest = 1e9;
    for (int a = 0; a <= 12; ++a) {
      for (int b = 0; b <= 12; ++b) {
        for (int c = 0; c <= 12; ++c) {
          if (a > 0 && a < 12 && b > 0 && b < 12 && c > 0 && c < 12) continue;  // the boundary is enough
          const Vector3d t =
              Vector3d::Constant(kMinTension_N) + (most - kMinTension_N) / 12 * Vector3d(a, b, c);
          nearest =
              std::min(nearest, (Sums(body, SolveStatics(body, t, Vector3d::Zero()).q) - wanted).norm());
        }
      }
    }
    EXPECT_LE(shape.target_error, nearest + 1e-9) << angle;
  }
  const TensionedShape away = inverse.ForTip({0.2, 0.1, 0.3}, 2.6);
  EXPECT_EQ(away.status, Status::kTargetUnreachable);
  EXPECT_GT(away.target_error, 0.2);
}

TEST(InverseEquilibrium, MotionAtRestIsTheStaticSolutionAndMotionBalances) {
  for (const Body& body : {ThreeTendons(), TwoSections(), AsBuilt()}) {
    const int k = 2 * body.sections();
    const InverseEquilibrium inverse(body, kMinTension_N, kMaxTension_N);
    VectorXd bend(k), rate(k), acceleration(k);
    for (int i = 0; i < k; ++i) {
      bend[i] = 0.4 - 0.25 * i;
      rate[i] = 2 - 1.1 * i;
      acceleration[i] = -10 + 9 * i;
    }
    const TensionedShape still = inverse.ForBending(bend);
    const TensionedShape zero = inverse.ForBending(bend, VectorXd::Zero(k), VectorXd::Zero(k));
    EXPECT_LT((still.tension_N - zero.tension_N).norm(), 1e-11);
    const TensionedShape moving = inverse.ForBending(bend, rate, acceleration);
    ASSERT_EQ(moving.status, Status::kOk);
    EXPECT_GT((still.tension_N - moving.tension_N).norm(), 1e-3);
    // Forward dynamics at those tensions gives the accelerations that were asked for.
    VectorXd dq(body.dof()), ddq(body.dof()), force(body.dof()), got(body.dof());
    body.SpreadBending(rate, dq);
    body.SpreadBending(acceleration, ddq);
    body.TendonForce(moving.q, moving.tension_N, force);
    Body::Workspace workspace(body);
    body.ForwardDynamics(moving.q, dq, force, got, workspace);
    EXPECT_LT((got - ddq).norm(), 1e-6 * ddq.norm());
    EXPECT_LT(moving.target_error, 1e-12);

    // One section's tips form a shell not a micrometre thick, which a heavy tip in motion need not meet.
    if (body.parameters().tip_payload_kg > 0) continue;
    const Vector3d tip = body.TipPose(still.q).p_WA;
    const TensionedShape tip_still = inverse.ForTip(tip, 2.6);
    const TensionedShape tip_zero = inverse.ForTip(tip, Vector3d::Zero(), Vector3d::Zero(), 2.6);
    EXPECT_LT((tip_still.tension_N - tip_zero.tension_N).norm(), 1e-7);
    const TensionedShape tip_moving = inverse.ForTip(tip, {0.02, 0.01, -0.005}, {0.1, 0, 0}, 2.6);
    EXPECT_EQ(tip_moving.status, Status::kOk) << tip_moving.target_error;
    EXPECT_LT(tip_moving.target_error, 1e-8);
  }
}

TEST(InverseEquilibrium, ImpossibleBoundsAreRefused) {
  const Body body = ThreeTendons();
  EXPECT_THROW(InverseEquilibrium(body, -1, 8), std::invalid_argument);
  EXPECT_THROW(InverseEquilibrium(body, 2, 1), std::invalid_argument);
  EXPECT_THROW(InverseEquilibrium(body, std::nan(""), 1), std::invalid_argument);
}

}  // namespace
}  // namespace tendril::model
