// An equilibrium that loading leads to, and one that it does not.
#include "tendril/model/loading.h"

#include <gtest/gtest.h>

#include "bodies.h"
#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

TEST(Loading, EndsWhereStaticsFollowsTheBranch) {
  const Body body(test::PaperBody());
  const Eigen::Vector3d tension_N(1.5, 0.3, 0.3);
  const Equilibrium found = SolveStatics(body, tension_N, Eigen::Vector3d::Zero());
  ASSERT_EQ(found.result, StaticsResult::kConverged);
  EXPECT_TRUE(LoadingEndsAt(body, tension_N, found.q));
  Eigen::VectorXd other = found.q;
  other[3] += 2e-6;
  EXPECT_FALSE(LoadingEndsAt(body, tension_N, other));
}

TEST(Loading, EndsNowhereWhereTheBranchBuckles) {
  const Body body(test::PaperBody());
  EXPECT_FALSE(LoadingEndsAt(body, Eigen::Vector3d::Constant(1e4), Eigen::VectorXd::Zero(body.dof())));
}

}  // namespace
}  // namespace tendril::model
