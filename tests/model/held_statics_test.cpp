// Equilibria of a body whose motors hold their angles, against statics at given tensions, finite differences
// and a slack tendon.
#include "tendril/model/held_statics.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "support/hose.h"
#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

BodyParameters Hose() {
  BodyParameters body;
  body.gravity_W_mps2 = {0, 0, 9.81};
  SectionParameters section = HoseSection(3, 0.035, 0);
  section.youngs_modulus_Pa = 4e7;
  section.torsion = section.extension = true;
  section.axial_stiffness_N = 2000;
  section.torsional_stiffness_Nm2 = 0.012;
  body.sections = {section, section};
  return body;
}

constexpr double kWidth_m = 1e-4;

Eigen::VectorXd Pull(const Body& body) {
  Eigen::VectorXd pull(body.tendons());
  pull << 0.006, 0.001, -0.003, 0.004, 0.002, 0.005, 0.001, -0.002;
  return pull;
}

TEST(HeldStatics, IsTheEquilibriumAtTheTensionsThatItFinds) {
  const Body body(Hose());
  HeldStatics held(body, Eigen::VectorXd::Constant(8, 3000), kWidth_m);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(body.dof());
  ASSERT_TRUE(held.Solve(Pull(body), q));
  const Equilibrium at_tensions = SolveStatics(body, held.tension_N(), Eigen::Vector3d(0, 0, 0));
  ASSERT_EQ(at_tensions.result, StaticsResult::kConverged);
  EXPECT_LT((at_tensions.q - q).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_GT(q.cwiseAbs().maxCoeff(), 0.02);
}

TEST(HeldStatics, ATendonPullsItsStretchAndNeverPushes) {
  const Body body(Hose());
  HeldStatics held(body, Eigen::VectorXd::Constant(8, 3000), kWidth_m);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(body.dof()), shortening(body.tendons());
  ASSERT_TRUE(held.Solve(Pull(body), q));
  body.TendonShortening(q, shortening);
  const Eigen::VectorXd stretch = Pull(body) - shortening;
  bool any_tight = false, any_slack = false;
  for (Eigen::Index j = 0; j < 8; ++j) {
    const bool tight = stretch[j] > 10 * kWidth_m, slack = stretch[j] < -10 * kWidth_m;
    if (tight || slack) {
      EXPECT_NEAR(held.tension_N()[j], tight ? 3000 * stretch[j] : 0, 1e-3);
    }
    any_tight |= tight;
    any_slack |= slack;
    EXPECT_GE(held.tension_N()[j], 0);
  }
  EXPECT_TRUE(any_tight);
  EXPECT_TRUE(any_slack);
}

TEST(HeldStatics, FrictionLeavesTheBodyAShareOfTheSpoolsTension) {
  const Body body(Hose());
  HeldStatics held(body, Eigen::VectorXd::Constant(8, 3000), kWidth_m);
  Eigen::VectorXd without = Eigen::VectorXd::Zero(body.dof()), q = without, shortening(body.tendons());
  ASSERT_TRUE(held.Solve(Pull(body), without));
  Eigen::VectorXd loss(8);
  loss << 0.4, 0, -0.3, 0.2, 0, 0.5, 0.1, 0;
  held.SetLoss(loss);
  ASSERT_TRUE(held.Solve(Pull(body), q));
  EXPECT_GT((q - without).cwiseAbs().maxCoeff(), 5e-3);
  body.TendonShortening(q, shortening);
  for (Eigen::Index j = 0; j < 8; ++j) {
    const double stretch = Pull(body)[j] - shortening[j];
    if (stretch < 10 * kWidth_m) continue;
    EXPECT_NEAR(held.tension_N()[j], std::exp(-loss[j]) * 3000 * stretch, 1e-3) << j;
  }
  const Equilibrium at_tensions = SolveStatics(body, held.tension_N(), Eigen::Vector3d(0, 0, 0));
  EXPECT_LT((at_tensions.q - q).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(HeldStatics, TheTangentIsTheDerivative) {
  const Body body(Hose());
  HeldStatics held(body, Eigen::VectorXd::Constant(8, 3000), kWidth_m);
  held.SetLoss(Eigen::VectorXd::LinSpaced(8, -0.3, 0.5));
  Eigen::VectorXd q = Eigen::VectorXd::Zero(body.dof()), ahead(body.dof()), behind(body.dof());
  ASSERT_TRUE(held.Solve(Pull(body), q));
  const Eigen::MatrixXd tangent = held.Tangent(Pull(body), q).reconstructedMatrix();
  constexpr double kStep = 1e-6;
  for (int i = 0; i < body.dof(); ++i) {
    Eigen::VectorXd moved = q;
    moved[i] = q[i] + kStep;
    held.Residual(Pull(body), moved, ahead);
    moved[i] = q[i] - kStep;
    held.Residual(Pull(body), moved, behind);
    const Eigen::VectorXd slope = (ahead - behind) / (2 * kStep);
    EXPECT_LT((slope - tangent.col(i)).cwiseAbs().maxCoeff(), 1e-5 * tangent.cwiseAbs().maxCoeff());
  }
}

TEST(HeldStatics, IsTheSameWhateverWasSolvedBefore) {
  const Body body(Hose());
  HeldStatics along(body, Eigen::VectorXd::Constant(8, 3000), kWidth_m);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(body.dof());
  for (int state = 0; state <= 40; ++state) {
    // Through the straight robot, where tendons go slack and tight, and back; the last step is a leap.
    const double share = state < 40 ? std::cos(0.15 * state) : 0.9;
    ASSERT_TRUE(along.Solve(share * Pull(body), q)) << state;
    HeldStatics anew(body, Eigen::VectorXd::Constant(8, 3000), kWidth_m);
    Eigen::VectorXd from_straight = Eigen::VectorXd::Zero(body.dof());
    ASSERT_TRUE(anew.Solve(share * Pull(body), from_straight)) << state;
    EXPECT_LT((q - from_straight).cwiseAbs().maxCoeff(), 1e-7) << state;
  }
}

TEST(HeldStatics, SaysThatItDoesNotArrive) {
  const Body body(Hose());
  HeldStatics held(body, Eigen::VectorXd::Constant(8, 3000), kWidth_m);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(body.dof());
  EXPECT_FALSE(held.Solve(Eigen::VectorXd::Constant(8, std::nan("")), q));
}

}  // namespace
}  // namespace tendril::model
