// Equilibria against an independent solution, closed forms and the physics of buckling; frequencies against
// the dynamics.
#include "tendril/model/statics.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "bodies.h"
#include "golden.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

const Vector3d kNoForce(0, 0, 0);

double Residual(const Body& body, const VectorXd& q, const VectorXd& tension, const Vector3d& tip_force) {
  VectorXd held(body.dof()), pulled(body.dof());
  body.StaticForce(q, tip_force, held);
  body.TendonForce(q, tension, pulled);
  return (held - pulled).lpNorm<Eigen::Infinity>();
}

void CheckGolden(const std::string& file, const BodyParameters& parameters, std::size_t rows) {
  const Body body(parameters);
  const test::Golden golden(file);
  ASSERT_EQ(golden.size(), rows);
  const int n = body.dof();
  for (std::size_t row = 0; row < rows; ++row) {
    SCOPED_TRACE(file + " row " + std::to_string(row + 2));
    const VectorXd tension = golden.At(row, "T1", body.tendons());
    const Vector3d force = golden.At(row, "fx", 3);
    const Equilibrium found = SolveStatics(body, tension, force);
    ASSERT_EQ(found.result, StaticsResult::kConverged);
    EXPECT_EQ(found.load_fraction, 1);
    EXPECT_LT((found.q - golden.At(row, "u1", n)).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_LT((body.TipPose(found.q).p_WA - golden.At(row, "x", 3)).norm(), 1e-14);
    const VectorXd f = NaturalFrequencies(body, found.q, tension, force), expected = golden.At(row, "f1", n);
    EXPECT_LT((f - expected).cwiseQuotient(expected).cwiseAbs().maxCoeff(), 1e-10);
  }
}

TEST(Statics, EquilibriaAndFrequenciesOfThePaperRobotAgreeWithTheIndependentSolution) {
  CheckGolden("statics_paper.csv", test::PaperBody(), 10);
}

TEST(Statics, EquilibriaAndFrequenciesOfTwoSectionsAgreeWithTheIndependentSolution) {
  CheckGolden("statics_two_sections.csv", test::TwoSections(), 3);
}

TEST(Statics, AnyTensionsUpToTheLimitWithATipForceAndInAnyAttitude) {
  test::Random random(5);
  for (const double unit_length_m : {0.015, 0.0225}) {
    for (int k = 0; k < 300; ++k) {
      BodyParameters parameters = test::PaperBody(4, unit_length_m);
      if (k % 3 == 1) parameters.gravity_W_mps2 = 9.81 * random.Vector(3, -1, 1).normalized();
      VectorXd tension = random.Vector(3, 0, 8);
      if (k % 5 == 0) tension = 8 * VectorXd::Unit(3, k % 3);
      const Vector3d force = k % 3 == 2 ? Vector3d(random.Vector(3, -0.1, 0.1)) : kNoForce;
      const Body body(parameters);
      const Equilibrium found = SolveStatics(body, tension, force);
      ASSERT_EQ(found.result, StaticsResult::kConverged) << tension.transpose() << " / " << force.transpose();
      EXPECT_LT(Residual(body, found.q, tension, force), 1e-16);
      EXPECT_LT(found.residual_Nm, 1e-16);
      EXPECT_GT(NaturalFrequencies(body, found.q, tension, force)[0], 0);

      // From anywhere downhill the same one is found: one section has no other stable shape here.
      const Equilibrium again = SolveStaticsFrom(body, random.Vector(body.dof(), -1, 1), tension, force);
      ASSERT_EQ(again.result, StaticsResult::kConverged);
      EXPECT_LT((again.q - found.q).norm(), 1e-10);
    }
  }
}

TEST(Statics, ARobotAsBuiltIsFollowedFromItsRestShape) {
  const BodyParameters built = test::AsBuilt();
  const Body body(built);
  test::Random random(8);
  for (int k = 0; k < 50; ++k) {
    const VectorXd tension = random.Vector(7, 0, 2);
    const Vector3d force = random.Vector(3, -0.02, 0.02);
    const Equilibrium found = SolveStatics(body, tension, force);
    ASSERT_EQ(found.result, StaticsResult::kConverged) << tension.transpose();
    EXPECT_LT(Residual(body, found.q, tension, force), 1e-16);

    // The body's own force is a force like any other, a payload a force of m g.
    BodyParameters bare = built;
    bare.tip_force_W_N.setZero();
    bare.tip_payload_kg = 0;
    const Vector3d all = force + built.tip_force_W_N + built.tip_payload_kg * built.gravity_W_mps2;
    const Equilibrium same = SolveStatics(Body(bare), tension, all);
    ASSERT_EQ(same.result, StaticsResult::kConverged);
    EXPECT_LT((same.q - found.q).norm(), 1e-12);
  }

  BodyParameters alone = built;  // without any load it lies in its rest shape
  alone.gravity_W_mps2.setZero();
  alone.tip_force_W_N.setZero();
  const Equilibrium rest = SolveStatics(Body(alone), VectorXd::Zero(7), kNoForce);
  ASSERT_EQ(rest.result, StaticsResult::kConverged);
  EXPECT_LT((rest.q - (VectorXd(10) << 0.15, -0.1, 0, 0, 0, 0, 0, 0.2, 0, 0).finished()).norm(), 1e-15);
}

// One unit without gravity and one tendon on the x side: k u = T (r c(u) - (l - r u) c'(u)) with
// c = sin(u/2) / (u/2), solved here by bisection.
TEST(Statics, OneUnitPulledByOneTendonSolvesItsScalarEquation) {
  BodyParameters parameters = test::PaperBody(1);
  parameters.gravity_W_mps2.setZero();
  const SectionParameters& s = parameters.sections[0];
  const double l = s.unit_length_m, r = 0.004;
  for (const double tension : {0.5, 3.0, 8.0}) {
    double low = 0, high = 3;
    for (int i = 0; i < 100; ++i) {
      const double u = (low + high) / 2;
      const double c = std::sin(u / 2) / (u / 2), slope = std::cos(u / 2) / u - 2 * std::sin(u / 2) / (u * u);
      (s.UnitStiffness() * u < tension * (r * c - (l - r * u) * slope) ? low : high) = u;
    }
    const Equilibrium found = SolveStatics(Body(parameters), Vector3d(tension, 0, 0), kNoForce);
    EXPECT_NEAR(found.q[0], low, 1e-13);
    EXPECT_NEAR(found.q[1], 0, 1e-15);
  }
}

// Without gravity a straight unit under equal tensions of sum G has the stiffness EI/l - G l/12: it buckles
// at G = 12 EI/l^2, all units at once.
TEST(Statics, EqualTensionsBuckleAtTheClosedFormLoad) {
  BodyParameters parameters = test::PaperBody();
  parameters.gravity_W_mps2.setZero();
  const Body body(parameters);
  const double critical = 12 * parameters.sections[0].UnitStiffness() / 0.0225;
  const VectorXd below = VectorXd::Constant(3, 0.999 * critical / 3),
                 above = VectorXd::Constant(3, 1.25 * critical / 3);
  EXPECT_EQ(SolveStatics(body, below, kNoForce).result, StaticsResult::kConverged);
  const Equilibrium buckled = SolveStatics(body, above, kNoForce);
  EXPECT_EQ(buckled.result, StaticsResult::kBuckled);
  EXPECT_NEAR(buckled.load_fraction, 1 / 1.25, 1e-6);

  // Straight is still an equilibrium there, but an unstable one: said, not returned as a solution.
  const VectorXd straight = VectorXd::Zero(body.dof());
  EXPECT_EQ(SolveStaticsFrom(body, straight, above, kNoForce).result, StaticsResult::kBuckled);
  EXPECT_LT(NaturalFrequencies(body, straight, above, kNoForce)[0], 0);
}

TEST(Statics, AnUprightRobotTooSoftForItsWeightBucklesAtZeroLoad) {
  BodyParameters parameters = test::PaperBody();
  parameters.sections[0].youngs_modulus_Pa /= 100;
  const Equilibrium found = SolveStatics(Body(parameters), VectorXd::Zero(3), kNoForce);
  EXPECT_EQ(found.result, StaticsResult::kBuckled);
  EXPECT_EQ(found.load_fraction, 0);
}

// A slightly uneven pull makes the buckled shape part of the branch: no loss of stability then, only a large
// bend.
TEST(Statics, AnUnevenPullPastTheBucklingLoadIsFollowed) {
  const Body body(test::PaperBody());
  EXPECT_EQ(SolveStatics(body, Vector3d(8, 8, 8), kNoForce).result, StaticsResult::kBuckled);
  double last = 0;
  for (const double less : {1e-5, 1e-3, 0.1}) {
    const Equilibrium found = SolveStatics(body, Vector3d(8 - less, 8, 8), kNoForce);
    ASSERT_EQ(found.result, StaticsResult::kConverged) << less;
    EXPECT_GT(-found.q[0], 0.3);
    EXPECT_GT(-found.q[0], last);
    last = -found.q[0];
  }
}

TEST(Statics, FrequenciesAreThoseOfTheLinearisedDynamics) {
  const Body body(test::PaperBody());
  const Vector3d tension(5, 1, 0.3);
  const Equilibrium found = SolveStatics(body, tension, kNoForce);
  const int n = body.dof();
  Body::Workspace workspace(body);
  const auto accelerate = [&](const VectorXd& q) {
    VectorXd force(n), ddq(n);
    body.TendonForce(q, tension, force);
    body.ForwardDynamics(q, VectorXd::Zero(n), force, ddq, workspace);
    return ddq;
  };
  MatrixXd slope(n, n);
  const double h = 1e-3;
  for (int i = 0; i < n; ++i) {
    const VectorXd e = h * VectorXd::Unit(n, i);
    slope.col(i) = (8 * (accelerate(found.q + e) - accelerate(found.q - e)) -
                    (accelerate(found.q + 2 * e) - accelerate(found.q - 2 * e))) /
                   (12 * h);
  }
  const Eigen::EigenSolver<MatrixXd> modes(slope, false);
  EXPECT_LT(modes.eigenvalues().imag().cwiseAbs().maxCoeff(),
            1e-6 * modes.eigenvalues().cwiseAbs().maxCoeff());
  VectorXd expected = (-modes.eigenvalues().real()).cwiseSqrt() / (2 * std::numbers::pi);
  std::sort(expected.begin(), expected.end());
  const VectorXd f = NaturalFrequencies(body, found.q, tension, kNoForce);
  EXPECT_LT((f - expected).cwiseQuotient(expected).cwiseAbs().maxCoeff(), 1e-6);
}

}  // namespace
}  // namespace tendril::model
