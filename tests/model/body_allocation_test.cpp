// Nothing the body does after its construction allocates: it runs inside the tick.
#include <gtest/gtest.h>

#include <vector>

#include "bodies.h"
#include "support/allocation_count.h"
#include "tendril/model/body.h"
#include "tendril/model/stumpff.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

class BodyAllocation : public testing::TestWithParam<BodyParameters> {};

TEST_P(BodyAllocation, NoCallOfTheBodyAllocates) {
  const Body body(GetParam());
  Body::Workspace workspace(body);
  const int n = body.dof(), m = body.tendons();
  test::Random random(1);
  const VectorXd q = random.Vector(n, -1, 1), dq = random.Vector(n, -1, 1), tension = random.Vector(m, 0, 5);
  VectorXd force(n), ddq(n), length(m), section(2 * body.sections());
  MatrixXd mass(n, n), tip_jacobian(6, n), jacobian(m, n), spans(m, body.disks());
  const Eigen::Matrix3Xd on_disks = Eigen::Matrix3Xd::Ones(3, body.units());
  std::vector<Pose> poses(static_cast<std::size_t>(body.units()));
  double sum = 0;

  const auto before = test::AllocationCount();
  body.Poses(q, poses);
  sum += body.TipPose(q).p_WA.x();
  body.TipJacobian(q, tip_jacobian);
  body.TendonLengths(q, length);
  body.TendonShortening(q, length);
  body.TendonLengthJacobian(q, jacobian);
  body.SpanShortening(q, spans);
  body.TendonTurns(q, spans);
  body.DiskForce(q, on_disks, force);
  body.TendonForce(q, tension, force);
  body.ForwardDynamics(q, dq, force, ddq, workspace);
  body.InverseDynamics(q, dq, ddq, force, workspace);
  body.MassMatrix(q, mass, workspace);
  sum += body.EnergyOf(q, dq, workspace).total();
  const TipWrench tip{Eigen::Vector3d(0.1, 0, 0), Eigen::Vector3d(0, 0.01, 0)};
  body.StaticForce(q, tip, force);
  body.TangentStiffness(q, tension, tip, mass);
  body.SumBending(q, section);
  body.ProjectForce(force, section);
  body.SpreadBending(section, ddq);
  sum += Stumpff(1)[0] + Stumpff(20)[0];
  EXPECT_EQ(test::AllocationCount(), before);
  EXPECT_TRUE(std::isfinite(sum));

  // Vectors of fixed size are taken as they are.
  if (n == 10) {
    Eigen::Matrix<double, 10, 1> q10 = q, force10 = Eigen::Matrix<double, 10, 1>::Zero(), ddq10;
    body.ForwardDynamics(q10, q10, force10, ddq10, workspace);
    body.InverseDynamics(q10, q10, ddq10, force10, workspace);
  }
  EXPECT_EQ(test::AllocationCount(), before);

  const VectorXd counted(3);  // the counter does count
  EXPECT_GT(test::AllocationCount(), before);
}

INSTANTIATE_TEST_SUITE_P(Robots, BodyAllocation,
                         testing::Values(test::TwoSections(), test::AsBuilt(), test::RandomStrained(3)));

}  // namespace
}  // namespace tendril::model
