// Antagonistic pairs: which tensions they take, and their allocation against a search over the pulls.
#include "tendril/model/tendon_pairs.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tendril/config/config.h"
#include "tendril/model/arc_tensions.h"
#include "tendril/model/bending_model.h"
#include "tendril/model/capstan.h"
#include "tendril/model/inverse_equilibrium.h"
#include "tendril/model/pull_map.h"
#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

RobotParameters Pairs() {
  return ControlModel(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/pairs_90mm.yaml"));
}

TEST(TendonPairs, TakeAPullAsTwoSpringsOnOneSpool) {
  RobotParameters robot = Pairs();
  robot.actuation->tendons[0].tendon.stiffness_Npm = 5000;
  const TendonPairs pairs(robot);
  TendonVector shortening_m(4);
  shortening_m << 0.004, 0.001, -0.0038, -0.0009;
  TendonVector tension_N(4);
  tension_N << 5, 0, 2, 1;
  EXPECT_FALSE(pairs.Share(shortening_m, 8, tension_N));
  // The spool's travel s follows from either tendon.
  const double s_a = (tension_N[0] - 4) / 5000 + shortening_m[0];
  const double s_b = -((tension_N[2] - 4) / 3000 + shortening_m[2]);
  EXPECT_NEAR(s_a, s_b, 1e-15);
  EXPECT_NEAR(tension_N[0] - tension_N[2], 3, 1e-12);
  EXPECT_NEAR(tension_N[1] - tension_N[3], -1, 1e-12);
}

TEST(TendonPairs, GiveNoMoreThanTheirPretension) {
  const RobotParameters robot = Pairs();
  const TendonPairs pairs(robot);
  TendonVector tension_N(4);
  tension_N << 9, 4, 0, 4;
  EXPECT_TRUE(pairs.Share(TendonVector::Zero(4), 20, tension_N));
  EXPECT_NEAR(tension_N[2], robot.limits.min_tension_N, 1e-12);
  EXPECT_NEAR(tension_N[0], 8 - robot.limits.min_tension_N, 1e-12);
}

// Held bends are in balance, and every pair's tensions are those that its springs take.
TEST(TendonPairs, HoldBendsWithTheirOwnTensions) {
  const RobotParameters robot = Pairs();
  const Body body(robot.body);
  const TendonPairs pairs(robot);
  ArcTensions arcs(body, pairs);
  TendonVector shortening_m(4);
  for (double angle = 0; angle < 6.3; angle += 0.35) {
    BendingVector bend(2);
    bend << 1.4 * std::cos(angle), 1.4 * std::sin(angle);
    const auto held = arcs.Hold(bend, robot.limits.min_tension_N, robot.limits.max_tension_base_N);
    ASSERT_EQ(held.status, Status::kOk) << angle;
    EXPECT_LT((arcs.force_per_tension() * held.tension_N - arcs.force_Nm()).norm(), 1e-9);
    body.TendonShortening(arcs.q(), shortening_m);
    TendonVector taken_N = held.tension_N;
    EXPECT_FALSE(pairs.Share(shortening_m, robot.limits.max_tension_base_N, taken_N));
    EXPECT_LT((taken_N - held.tension_N).cwiseAbs().maxCoeff(), 1e-12);
    // What both have without pull is less than assembly gave, by what the bend takes.
    EXPECT_LT(TendonPairs::Unpulled_N(pairs.all()[0], shortening_m), 4.0);
  }
}

TEST(TendonPairs, SayWhenABendNeedsMore) {
  RobotParameters robot = Pairs();
  const Body body(robot.body);
  robot.actuation->pairs[0].pretension_N = 1;
  ArcTensions arcs(body, TendonPairs(robot));
  BendingVector bend(2);
  bend << 1.4, 0;
  const auto held = arcs.Hold(bend, robot.limits.min_tension_N, robot.limits.max_tension_base_N);
  EXPECT_EQ(held.status, Status::kLimitedTensionMax);
  EXPECT_EQ(held.bound, Status::kLimitedTensionMax);
  EXPECT_NEAR(held.tension_N.minCoeff(), robot.limits.min_tension_N, 1e-9);
}

// More drives than forces: of all pulls with the force, those of least squared change of the tensions.
TEST(TendonPairs, ShareAForceAmongMoreDrivesThanItNeeds) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> entry(-1, 1);
  RobotParameters robot = Pairs();
  robot.body.sections[0].tendons.push_back({0.7, 0.004});
  robot.actuation->tendons.push_back(robot.actuation->tendons[0]);
  const TendonPairs pairs(robot);
  const double least_N = robot.limits.min_tension_N;
  for (int trial = 0; trial < 200; ++trial) {
    Eigen::MatrixXd a(2, 5);
    for (int i = 0; i < a.size(); ++i) a.data()[i] = entry(random);
    TendonVector made_N(5);
    made_N << 4, 4, 4, 4, least_N + 1 + entry(random);
    const double p = 3 * entry(random), q = 3 * entry(random);
    made_N[0] += p, made_N[2] -= p, made_N[1] += q, made_N[3] -= q;
    const Eigen::VectorXd force = a * made_N;
    const auto found = TensionAllocator(5, 2, pairs).Allocate(a, force, least_N, 8.0);
    ASSERT_EQ(found.status, Status::kOk);
    EXPECT_LT((a * found.tension_N - force).norm(), 1e-8);
    EXPECT_NEAR(found.tension_N[0] + found.tension_N[2], 8, 1e-12);
    EXPECT_NEAR(found.tension_N[1] + found.tension_N[3], 8, 1e-12);
    EXPECT_GE(found.tension_N.minCoeff(), least_N - 1e-9);
    // The force leaves one way to change the three drives together.
    Eigen::Matrix<double, 5, 3> drives;
    drives.setZero();
    drives.col(0) << 1, 0, -1, 0, 0;
    drives.col(1) << 0, 1, 0, -1, 0;
    drives.col(2) << 0, 0, 0, 0, 1;
    const Eigen::Vector3d way = Eigen::MatrixXd(a * drives).fullPivLu().kernel().col(0);
    const auto cost = [&](const TendonVector& t) {
      TendonVector change_N = t - TendonVector::Constant(5, 4.0);
      change_N[4] = t[4] - least_N;
      return change_N.squaredNorm();
    };
    for (const double by : {-1e-3, 1e-3}) {
      const TendonVector other_N = found.tension_N + TendonVector(by * (drives * way));
      if (other_N.minCoeff() < least_N || other_N.maxCoeff() > 8) continue;
      EXPECT_GE(cost(other_N), cost(found.tension_N) - 1e-9);
    }
  }
}

// The units' own equilibrium: in balance, with tensions that the pairs can take.
TEST(TendonPairs, InverseEquilibriaAreTheirs) {
  const RobotParameters robot = Pairs();
  const Body body(robot.body);
  const TendonPairs pairs(robot);
  const InverseEquilibrium inverse(body, robot.limits.min_tension_N, robot.limits.max_tension_base_N, pairs);
  TendonVector shortening_m(4);
  for (const double angle : {0.0, 0.8, 2.9, 5.0}) {
    const Eigen::Vector2d bend(1.2 * std::cos(angle), 1.2 * std::sin(angle));
    const TensionedShape found = inverse.ForBending(bend);
    ASSERT_EQ(found.status, Status::kOk);
    body.TendonShortening(found.q, shortening_m);
    TendonVector taken_N = found.tension_N;
    EXPECT_FALSE(pairs.Share(shortening_m, robot.limits.max_tension_base_N, taken_N));
    EXPECT_LT((taken_N - found.tension_N).cwiseAbs().maxCoeff(), 1e-6);
    const Equilibrium still = SolveStatics(body, found.tension_N, {});
    EXPECT_LT((still.q - found.q).cwiseAbs().maxCoeff(), 1e-7);
  }
}

// Both ways through the pulleys, for both directions of sliding; the spool's tensions are those of the
// springs.
TEST(PullMap, OfAPairIsInvertible) {
  const RobotParameters robot = Pairs();
  const auto tables = MakeCapstanTables(robot.actuation->tendons, 20);
  const auto& tendons = robot.actuation->tendons;
  const TendonPairs pairs(robot);
  PullMap map(pairs.all()[0], tendons[0].transmission, tables[0], tendons[2].transmission, tables[2]);
  map.SetUnpulled(3.5);
  for (const double z : {-1.0, -0.4, 0.0, 1.0}) {
    for (double pull_N = -5; pull_N <= 5; pull_N += 0.5) {
      const double motor_N = map.BaseToMotor(pull_N, z);
      EXPECT_NEAR(map.MotorToBase(motor_N, z), pull_N, 1e-8);
      EXPECT_LE(map.LeastAtMotor(pull_N), motor_N + 1e-8);
      EXPECT_GE(map.MostAtMotor(pull_N), motor_N - 1e-8);
      const auto spool = map.AtMotor(motor_N);
      EXPECT_NEAR(spool.first_N + spool.second_N, 7, 1e-12);
      EXPECT_NEAR(spool.first_N - spool.second_N, motor_N, 1e-12);
      const auto base = map.AtBase(motor_N, z);
      EXPECT_NEAR(base.first_N - base.second_N, pull_N, 1e-8);
      if (z == 1 && spool.second_N > 0) {
        EXPECT_LT(base.first_N, spool.first_N);
        EXPECT_GT(base.second_N, spool.second_N);
      }
    }
  }
  EXPECT_DOUBLE_EQ(map.Within(20, 6), 5);
  EXPECT_DOUBLE_EQ(map.Within(-20, 6), -5);
  EXPECT_DOUBLE_EQ(map.Within(3, 6), 3);
}

}  // namespace
}  // namespace tendril::model
