// Inverse kinematics: round trips, nearest points against brute force, limits, warm starts; and the force per
// tension against finite differences of the tendon lengths.
#include "tendril/model/inverse.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <random>

namespace tendril::model {
namespace {

using Eigen::Vector3d;
using std::numbers::pi;

SectionParameters Section(int units, double unit_length_m, int tendons, double twist_rad = 0) {
  SectionParameters s;
  s.units = units;
  s.unit_length_m = unit_length_m;
  s.unit_mass_kg = 0.0025;
  s.disk_inertia_xx_kgm2 = 1.5625e-8;
  s.disk_inertia_zz_kgm2 = 3.125e-8;
  s.youngs_modulus_Pa = 2.3e10;
  s.core_radius_m = 0.5e-3;
  for (int j = 0; j < tendons; ++j) s.tendons.push_back({twist_rad + 2 * pi * j / tendons, 0.004});
  return s;
}

Body OneSection() {
  BodyParameters p;
  p.sections = {Section(4, 0.0225, 3)};
  return Body(p);
}

Body Sections(int count) {
  BodyParameters p;
  for (int k = 0; k < count; ++k) p.sections.push_back(Section(3 + k, 0.015 + 0.002 * k, 3 + k % 2, 0.5 * k));
  return Body(p);
}

BendingVector Random(std::mt19937& random, int sections, double most) {
  std::uniform_real_distribution<double> uniform(0, 1);
  BendingVector q(2 * sections);
  for (int k = 0; k < sections; ++k) {
    const double bend = most * uniform(random), plane = 2 * pi * uniform(random);
    q.segment<2>(2 * k) = bend * Eigen::Vector2d(std::cos(plane), std::sin(plane));
  }
  return q;
}

double LargestBend(const BendingVector& q) {
  double largest = 0;
  for (int k = 0; k < q.size() / 2; ++k) largest = std::max(largest, q.segment<2>(2 * k).norm());
  return largest;
}

TEST(InverseKinematics, TipIsTheBodysTipOfTheSpreadShape) {
  std::mt19937 random(1);
  for (int sections = 1; sections <= 4; ++sections) {
    const Body body = Sections(sections);
    const InverseKinematics ik(body, pi);
    for (int i = 0; i < 50; ++i) {
      const BendingVector bend = Random(random, sections, pi);
      Eigen::VectorXd q(body.dof());
      body.SpreadBending(bend, q);
      EXPECT_LT((ik.Tip(bend) - body.TipPose(q).p_WA).norm(), 1e-15);
    }
  }
}

TEST(InverseKinematics, OneSectionRoundTrip) {
  const Body body = OneSection();
  const InverseKinematics ik(body, 1.9 * pi);
  const BendingVector seed = BendingVector::Zero(2);
  for (double theta : {0.0, 1e-12, 1e-6, 0.01, 0.5, 1.6, 3.0, pi, 4.0, 5.5}) {
    for (double beta = -3.1; beta < 3.15; beta += 0.31) {
      const BendingVector bend = theta * Eigen::Vector2d(std::cos(beta), std::sin(beta));
      const auto solution = ik.Solve(ik.Tip(bend), seed);
      EXPECT_EQ(solution.status, Status::kOk);
      EXPECT_LT((solution.us_vs - bend).norm(), 1e-13 * (1 + theta)) << theta << " " << beta;
      EXPECT_LT(solution.distance_m, 1e-16);
    }
  }
}

TEST(InverseKinematics, OneSectionFindsTheTrulyNearestPoint) {
  const Body body = OneSection();
  const double length = 0.09;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (double most : {0.5, 1.8, pi, 2 * pi}) {
    const InverseKinematics ik(body, most);
    for (int i = 0; i < 300; ++i) {
      const Vector3d target = 0.12 * Vector3d(uniform(random), uniform(random), uniform(random));
      const auto solution = ik.Solve(target, BendingVector::Zero(2));
      double nearest = 1e9;
      for (int k = 0; k <= 20000; ++k) {
        const double theta = most * k / 20000;
        const double r = theta > 0 ? length * (1 - std::cos(theta)) / theta : 0;
        const double z = theta > 0 ? length * std::sin(theta) / theta : length;
        nearest = std::min(nearest, std::hypot(std::hypot(target.x(), target.y()) - r, target.z() - z));
      }
      EXPECT_LE(solution.distance_m, nearest + 1e-15);
      EXPECT_GE(solution.distance_m, nearest - 1e-7) << "beyond the grid's own error";
      EXPECT_LE(solution.us_vs.norm(), most * (1 + 1e-15));
      EXPECT_EQ(solution.status, Status::kTargetUnreachable);
      EXPECT_NEAR((solution.tip_W_m - target).norm(), solution.distance_m, 1e-18);
      if (solution.us_vs.norm() < most * (1 - 1e-12) && solution.us_vs.norm() > 0) {
        // At a nearest point the way to the target is square to the surface.
        BendingVector moved = solution.us_vs * (1 + 1e-6);
        const Vector3d along = (ik.Tip(moved) - solution.tip_W_m).normalized();
        EXPECT_NEAR(along.dot((target - solution.tip_W_m).normalized()), 0, 1e-5);
      }
    }
  }
}

TEST(InverseKinematics, OnTheAxisTheSeedChoosesThePlane) {
  const Body body = OneSection();
  const InverseKinematics ik(body, pi);
  const Vector3d below(0, 0, 0.01);  // nearer to the curled tip than to the straight one
  for (double beta : {0.3, 2.0, -2.5}) {
    const BendingVector seed = 0.1 * Eigen::Vector2d(std::cos(beta), std::sin(beta));
    const auto solution = ik.Solve(below, seed);
    EXPECT_GT(solution.us_vs.norm(), 1);
    EXPECT_NEAR(std::atan2(solution.us_vs[1], solution.us_vs[0]), beta, 1e-12);
  }
  EXPECT_TRUE(ik.Solve(below, BendingVector::Zero(2)).us_vs.allFinite());
  const auto straight = ik.Solve({0, 0, 0.09}, BendingVector::Zero(2));
  EXPECT_EQ(straight.status, Status::kOk);
  EXPECT_LT(straight.us_vs.norm(), 1e-7);
}

TEST(InverseKinematics, PapersCircle) {
  // Eq. 31 with the 60 mm robot: radius 28.6479 mm at height 49.6196 mm is a bend of 60 degrees.
  BodyParameters p;
  p.sections = {Section(4, 0.015, 3)};
  const Body body{p};
  const InverseKinematics ik(body, 2);
  const auto solution = ik.Solve({0.0286479, 0, 0.0496196}, BendingVector::Zero(2));
  EXPECT_NEAR(solution.us_vs[0], pi / 3, 2e-6);
  EXPECT_NEAR(solution.us_vs[1], 0, 1e-15);
  EXPECT_LT(solution.distance_m, 1e-7) << "six digits were printed";
}

TEST(InverseKinematics, SeveralSectionsReachWhatTheyCan) {
  std::mt19937 random(3);
  for (int sections = 2; sections <= 4; ++sections) {
    const Body body = Sections(sections);
    const double most = 2.0;
    const InverseKinematics ik(body, most);
    int from_cold = 0;
    for (int i = 0; i < 100; ++i) {
      const Vector3d target = ik.Tip(Random(random, sections, most));
      const auto solution = ik.Solve(target, BendingVector::Zero(2 * sections));
      EXPECT_LE(LargestBend(solution.us_vs), most * (1 + 1e-12));
      from_cold += solution.status == Status::kOk;
      EXPECT_LE(solution.iterations, 260);
      if (solution.status == Status::kOk) {
        EXPECT_LT((ik.Tip(solution.us_vs) - target).norm(), 1.1e-9);
      }
    }
    EXPECT_GE(from_cold, 99) << sections << " sections";
  }
}

TEST(InverseKinematics, WarmStartsFollowAPathSmoothly) {
  for (int sections = 2; sections <= 3; ++sections) {
    const Body body = Sections(sections);
    const InverseKinematics ik(body, 2.0);
    const double length = body.parameters().length_m();
    BendingVector seed = ik.Solve({0.4 * length, 0, 0.8 * length}, BendingVector::Zero(2 * sections)).us_vs;
    for (int i = 1; i <= 3000; ++i) {
      const double t = 2 * pi * i / 3000;
      const Vector3d target(0.4 * length * std::cos(t), 0.4 * length * std::sin(t), 0.8 * length);
      const auto solution = ik.Solve(target, seed);
      ASSERT_EQ(solution.status, Status::kOk);
      ASSERT_LE(solution.iterations, 5);
      ASSERT_LT((solution.us_vs - seed).norm(), 0.02) << "no jump from one target to the next";
      seed = solution.us_vs;
    }
  }
}

TEST(InverseKinematics, SeveralSectionsGoNearestToWhatTheyCannotReach) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const Body body = Sections(2);
  const double most = 1.2;
  const InverseKinematics ik(body, most);
  int nearest_found = 0, cases = 0;
  for (int i = 0; i < 40; ++i) {
    const Vector3d target = 0.2 * Vector3d(uniform(random), uniform(random), uniform(random));
    const auto solution = ik.Solve(target, BendingVector::Zero(4));
    if (solution.status == Status::kOk) continue;
    ++cases;
    EXPECT_EQ(solution.status, Status::kTargetUnreachable) << i;
    EXPECT_LE(LargestBend(solution.us_vs), most * (1 + 1e-12));
    // Random search around: nothing nearby is nearer; and from many starts nothing much nearer exists.
    double nearest = solution.distance_m;
    for (int k = 0; k < 20000; ++k) {
      BendingVector other =
          k % 2 ? Random(random, 2, most) : BendingVector(solution.us_vs + 0.01 * Random(random, 2, 1));
      if (LargestBend(other) <= most) nearest = std::min(nearest, (ik.Tip(other) - target).norm());
    }
    nearest_found += nearest >= solution.distance_m - 1e-12;
  }
  EXPECT_GT(cases, 20);
  EXPECT_EQ(nearest_found, cases);
}

TEST(InverseKinematics, StraightUpBeyondReachAndBelowTheTip) {
  const Body body = Sections(2);
  const InverseKinematics ik(body, 2.0);
  const double length = body.parameters().length_m();
  const auto above = ik.Solve({0, 0, length + 0.01}, BendingVector::Constant(4, 0.3));
  EXPECT_EQ(above.status, Status::kTargetUnreachable);
  EXPECT_NEAR(above.distance_m, 0.01, 1e-12);
  // From the straight shape the way down has no slope, but there is one.
  const auto below = ik.Solve({0, 0, 0.9 * length}, BendingVector::Zero(4));
  EXPECT_EQ(below.status, Status::kOk);
}

TEST(InverseKinematics, NonsenseIsAnswered) {
  const Body body = OneSection();
  EXPECT_THROW(InverseKinematics(body, 0), std::invalid_argument);
  EXPECT_THROW(InverseKinematics(body, 7), std::invalid_argument);
  const InverseKinematics ik(body, 2);
  const auto nan = ik.Solve({std::nan(""), 0, 0}, BendingVector::Zero(2));
  EXPECT_EQ(nan.status, Status::kSolverFallback);
  EXPECT_TRUE(nan.us_vs.allFinite());
  const auto at_base = ik.Solve({0, 0, 0}, BendingVector::Zero(2));
  EXPECT_EQ(at_base.status, Status::kTargetUnreachable);
  EXPECT_NEAR(at_base.us_vs.norm(), 2, 1e-12);
}

TEST(SectionForce, IsTheSlopeOfTheTendonLengths) {
  std::mt19937 random(5);
  for (int sections = 1; sections <= 3; ++sections) {
    const Body body = Sections(sections);
    const int n = 2 * sections, m = body.tendons();
    for (int repeat = 0; repeat < 20; ++repeat) {
      const BendingVector at =
          repeat == 0 ? BendingVector(BendingVector::Zero(n)) : Random(random, sections, 2);
      Eigen::MatrixXd jacobian(n, m);
      SectionForcePerTension(body, at, jacobian);
      for (int i = 0; i < n; ++i) {
        Eigen::VectorXd plus(m), minus(m), q(body.dof());
        BendingVector moved = at;
        moved[i] = at[i] + 1e-4;
        body.SpreadBending(moved, q);
        body.TendonLengths(q, plus);
        moved[i] = at[i] - 1e-4;
        body.SpreadBending(moved, q);
        body.TendonLengths(q, minus);
        EXPECT_LT((jacobian.row(i).transpose() + (plus - minus) / 2e-4).cwiseAbs().maxCoeff(), 1e-10);
      }
    }
  }
}

}  // namespace
}  // namespace tendril::model
