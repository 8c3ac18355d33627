// Least tensions of a bend: what they produce on the sections is what stands against it, by elasticity and
// gravity at rest and by the mass matrix in motion; none is below the least that is asked for.
#include "tendril/model/arc_tensions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "bodies.h"

namespace tendril::model {
namespace {

constexpr double kLeast_N = 0.3, kMost_N = 50;

Eigen::VectorXd Produced(const Body& body, const BendingVector& us_vs, const TendonVector& tension_N) {
  Eigen::MatrixXd per_tension(2 * body.sections(), body.tendons());
  SectionForcePerTension(body, us_vs, per_tension);
  return per_tension * tension_N;
}

TEST(ArcTensions, AtRestTheyBalanceElasticityAndGravity) {
  for (const BodyParameters& parameters : {test::PaperBody(), test::TwoSections()}) {
    const Body body(parameters);
    BendingVector bend = BendingVector::Zero(2 * body.sections());
    bend.head<2>() << 0.8, -0.3;
    const auto held = ArcTensions(body).Hold(bend, kLeast_N, kMost_N);
    ASSERT_EQ(held.status, Status::kOk);
    EXPECT_NEAR(held.tension_N.minCoeff(), kLeast_N, 1e-9) << "more than is needed";
    Eigen::VectorXd q(body.dof()), force(body.dof()), section(2 * body.sections());
    body.SpreadBending(bend, q);
    body.StaticForce(q, Eigen::Vector3d::Zero(), force);
    body.ProjectForce(force, section);
    EXPECT_LT((Produced(body, bend, held.tension_N) - section).norm(), 1e-9);
  }
}

TEST(ArcTensions, AnAccelerationAddsTheMassMatrixTimesIt) {
  const Body body(test::PaperBody());
  const Eigen::Vector2d bend(0.8, -0.3), still(0, 0), acceleration(20, 5);
  ArcTensions arcs(body);
  const auto held = arcs.Hold(bend, kLeast_N, kMost_N),
             moved = arcs.Move(bend, still, acceleration, kLeast_N, kMost_N);
  Eigen::VectorXd q(body.dof()), ddq(body.dof()), section(2);
  Eigen::MatrixXd mass(body.dof(), body.dof());
  Body::Workspace workspace(body);
  body.SpreadBending(bend, q);
  body.SpreadBending(acceleration, ddq);
  body.MassMatrix(q, mass, workspace);
  const Eigen::VectorXd inertia = mass * ddq;
  body.ProjectForce(inertia, section);
  const Eigen::VectorXd added = Produced(body, bend, moved.tension_N) - Produced(body, bend, held.tension_N);
  EXPECT_GT(section.norm(), 1e-6);
  EXPECT_LT((added - section).norm(), 1e-9 + 1e-6 * section.norm());
  EXPECT_EQ(arcs.Hold(bend, kLeast_N, kMost_N).tension_N, held.tension_N) << "it remembers";
}

}  // namespace
}  // namespace tendril::model
