// What the tick calls from inverse kinematics to friction compensation allocates nothing, whatever the
// answer.
#include <gtest/gtest.h>

#include "bodies.h"
#include "support/allocation_count.h"
#include "tendril/model/capstan.h"
#include "tendril/model/inverse.h"

namespace tendril::model {
namespace {

TEST(TickAllocation, InverseKinematicsAllocationAndCapstanAllocateNothing) {
  for (const BodyParameters& parameters : {test::PaperBody(), test::TwoSections()}) {
    const Body body(parameters);
    const InverseKinematics ik(body, 2);
    const int k = 2 * body.sections();
    const TensionAllocator allocator(body.tendons(), k);
    TransmissionParameters transmission;
    transmission.pulleys = {{CapstanLaw::kCumulative, 3, 10, 0.466, 0.67, 0}};
    const CapstanTable table(transmission, 12);
    const BendingVector seed = BendingVector::Constant(k, 0.1);
    Eigen::MatrixXd per_tension(k, body.tendons());
    Eigen::MatrixXd dependent = Eigen::MatrixXd::Ones(k, body.tendons());
    dependent.row(0) *= 2;
    const Eigen::VectorXd force = Eigen::VectorXd::Constant(k, 0.005), much = 100 * force;
    double sum = 0;

    const auto before = test::AllocationCount();
    const double length = parameters.length_m();
    sum += ik.Solve({0.2 * length, 0.1 * length, 0.9 * length}, seed).distance_m;
    sum += ik.Solve({length, length, length}, seed).distance_m;  // out of reach
    sum += ik.Solve({0, 0, 0.5 * length}, seed).distance_m;
    SectionForcePerTension(body, seed, per_tension);
    sum += allocator.Allocate(per_tension, force, 0.3, 8).residual_Nm;
    sum += allocator.Allocate(per_tension, much, 0.3, 8).residual_Nm;  // beyond the limits
    sum += allocator.Allocate(dependent, force, 0.3, 8).residual_Nm;
    sum += table.Pull(3) + table.Release(3) + table.MotorToBase(2, 0.3) + table.PullSlope(1) +
           table.ReleaseSlope(1);
    EXPECT_EQ(test::AllocationCount(), before);
    EXPECT_TRUE(std::isfinite(sum));
  }
}

}  // namespace
}  // namespace tendril::model
