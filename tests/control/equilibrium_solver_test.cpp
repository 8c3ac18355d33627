// The equilibrium solver against the statics solver of the model, which knows nothing of it, and within the
// tick.
#include "tendril/control/equilibrium_solver.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "ideal_loop.h"
#include "support/rig_file.h"
#include "tendril/model/inverse.h"
#include "tendril/model/statics.h"

namespace tendril::control {
namespace {

using test::Rig;

BendingReference At(const BendingVector& position) {
  const BendingVector zero = BendingVector::Zero(position.size());
  return {position, zero, zero};
}

// Tensions of the arc, as the paper's law has them.
TendonVector ArcTension(const model::Body& body, const RobotParameters& robot, const BendingVector& bend) {
  UnitVector q(body.dof()), force(body.dof());
  BendingVector section(bend.size());
  body.SpreadBending(bend, q);
  body.StaticForce(q, Eigen::Vector3d::Zero(), force);
  body.ProjectForce(force, section);
  Eigen::MatrixXd per_tension(bend.size(), body.tendons());
  model::SectionForcePerTension(body, bend, per_tension);
  return model::TensionAllocator(body.tendons(), static_cast<int>(bend.size()))
      .Allocate(per_tension, section, robot.limits.min_tension_N, robot.limits.max_tension_base_N)
      .tension_N;
}

Eigen::Vector3d ArcTip(const model::Body& body, const BendingVector& bend) {
  UnitVector q(body.dof());
  body.SpreadBending(bend, q);
  return body.TipPose(q).p_WA;
}

Status Solve(EquilibriumSolver& law, const BendingReference& reference, const TendonVector& arc_N,
             double least_N, const Eigen::Vector3d& shift_W_m = Eigen::Vector3d::Zero()) {
  const TendonVector most_N = TendonVector::Constant(arc_N.size(), 1e3);
  return law.Solve(reference, arc_N, least_N, most_N, shift_W_m, 0 * reference.position_rad);
}

// The body's real equilibrium at the law's tensions, followed from zero load by another solver, has its tip
// where the arc's is, but for what stands at right angles to every motion of the tip.
TEST(EquilibriumSolver, TheTrueEquilibriumHasItsTipOnTarget) {
  for (const char* name : {"rig_60mm", "rig_90mm", "four_tendon_90mm"}) {
    const RobotParameters robot = Rig(name);
    const model::Body body(robot.body);
    for (const double bend : {0.1, 0.6, 1.2}) {
      for (const double plane : {0.0, 0.7, 2.5, -1.9}) {
        EquilibriumSolver law(body, robot.limits);
        BendingVector us_vs(2);
        us_vs << bend * std::cos(plane), bend * std::sin(plane);
        const TendonVector arc_N = ArcTension(body, robot, us_vs);
        ASSERT_EQ(Solve(law, At(us_vs), arc_N, robot.limits.min_tension_N), Status::kOk)
            << name << " " << bend;
        const auto truth = model::SolveStatics(body, law.tension_N(), Eigen::Vector3d::Zero());
        ASSERT_EQ(truth.result, model::StaticsResult::kConverged);
        EXPECT_LT((truth.q - law.q()).cwiseAbs().maxCoeff(), 1e-7) << name << " " << bend << " " << plane;

        const Eigen::Vector3d goal = ArcTip(body, us_vs), gap = body.TipPose(truth.q).p_WA - goal;
        Eigen::MatrixXd jacobian(6, body.dof());
        body.TipJacobian(truth.q, jacobian);
        Eigen::Matrix<double, 3, 2> motion = Eigen::Matrix<double, 3, 2>::Zero();
        for (int i = 0; i < body.dof(); ++i) motion.col(i % 2) += jacobian.col(i).head<3>();
        EXPECT_LT((motion.transpose() * gap).norm() / motion.norm(), 1e-9)
            << "what bending can reach, is reached";

        const auto arc = model::SolveStatics(body, arc_N, Eigen::Vector3d::Zero());
        EXPECT_LT(gap.norm(), 0.35 * (body.TipPose(arc.q).p_WA - goal).norm())
            << "the arc's tensions miss it";
        EXPECT_GE(law.tension_N().minCoeff(), robot.limits.min_tension_N - 1e-12);
        EXPECT_LE(law.tension_N().maxCoeff(), robot.limits.max_tension_base_N + 1e-12);
      }
    }
  }
}

TEST(EquilibriumSolver, BringsTheEndOfEverySectionThere) {
  const RobotParameters robot = Rig("two_section");
  const model::Body body(robot.body);
  EquilibriumSolver law(body, robot.limits);
  BendingVector us_vs(4);
  us_vs << 0.4, -0.2, -0.3, 0.5;
  const TendonVector arc_N = ArcTension(body, robot, us_vs);
  ASSERT_EQ(Solve(law, At(us_vs), arc_N, robot.limits.min_tension_N), Status::kOk);
  const auto truth = model::SolveStatics(body, law.tension_N(), Eigen::Vector3d::Zero());
  const auto arc = model::SolveStatics(body, arc_N, Eigen::Vector3d::Zero());
  ASSERT_EQ(truth.result, model::StaticsResult::kConverged);
  UnitVector arc_q(body.dof());
  body.SpreadBending(us_vs, arc_q);
  std::vector<model::Pose> goal(body.units()), is(body.units()), by_arc(body.units());
  body.Poses(arc_q, goal);
  body.Poses(truth.q, is);
  body.Poses(arc.q, by_arc);
  for (int k = 0; k < 2; ++k) {
    const int end = body.end_unit(k) - 1;
    EXPECT_LT((is[end].p_WA - goal[end].p_WA).norm(), 0.4 * (by_arc[end].p_WA - goal[end].p_WA).norm()) << k;
  }
}

TEST(EquilibriumSolver, AShiftOfTheGoalMovesTheTip) {
  const RobotParameters robot = Rig("rig_60mm");
  const model::Body body(robot.body);
  EquilibriumSolver law(body, robot.limits);
  BendingVector us_vs(2);
  us_vs << 0.8, 0.3;
  const TendonVector arc_N = ArcTension(body, robot, us_vs);
  ASSERT_EQ(Solve(law, At(us_vs), arc_N, robot.limits.min_tension_N), Status::kOk);
  const Eigen::Vector3d before = body.TipPose(law.q()).p_WA;
  const Eigen::Vector3d along = Eigen::Vector3d(-0.3, 0.8, 0).normalized();  // across the bending plane
  ASSERT_EQ(Solve(law, At(us_vs), arc_N, robot.limits.min_tension_N, 1e-3 * along), Status::kOk);
  EXPECT_NEAR((body.TipPose(law.q()).p_WA - before).dot(along), 1e-3, 2e-5);
}

// The tension that a fast motion adds to every tendon does not move the tip.
TEST(EquilibriumSolver, MoreTensionInEveryTendonLeavesTheTipWhereItIs) {
  const RobotParameters robot = Rig("rig_60mm");
  const model::Body body(robot.body);
  EquilibriumSolver law(body, robot.limits);
  BendingVector us_vs(2);
  us_vs << 0.8, 0.3;
  const TendonVector arc_N = ArcTension(body, robot, us_vs);
  ASSERT_EQ(Solve(law, At(us_vs), arc_N, 0.3), Status::kOk);
  const Eigen::Vector3d before = body.TipPose(law.q()).p_WA;
  EXPECT_NEAR(law.tension_N().minCoeff(), 0.3, 1e-9);
  ASSERT_EQ(Solve(law, At(us_vs), arc_N, 0.9), Status::kOk);
  EXPECT_NEAR(law.tension_N().minCoeff(), 0.9, 1e-9);
  EXPECT_LT((body.TipPose(law.q()).p_WA - before).norm(), 2e-5);
  ASSERT_EQ(Solve(law, At(us_vs), arc_N, 0), Status::kOk);
  EXPECT_NEAR(law.tension_N().minCoeff(), robot.limits.min_tension_N, 1e-9) << "never below the robot's own";
}

// A moment that the model lacks, here that of a backbone a fifth stiffer: with it the tensions are those of
// the stiffer robot.
TEST(EquilibriumSolver, AMomentThatTheModelLacksMakesItTheOtherRobot) {
  const RobotParameters robot = Rig("rig_60mm");
  RobotParameters stiffer = robot;
  stiffer.body.sections[0].youngs_modulus_Pa *= 1.2;
  const model::Body body(robot.body), other(stiffer.body);
  EquilibriumSolver law(body, robot.limits), true_law(other, robot.limits);
  BendingVector us_vs(2);
  us_vs << 0.8, 0.3;
  const TendonVector arc_N = ArcTension(body, robot, us_vs);
  ASSERT_EQ(Solve(true_law, At(us_vs), arc_N, 0.3), Status::kOk);
  const BendingVector lacking_Nm = 0.2 * body.unit_stiffness_Nm(0) / body.units() * us_vs;
  ASSERT_EQ(law.Solve(At(us_vs), arc_N, 0.3, TendonVector::Constant(arc_N.size(), 8), Eigen::Vector3d::Zero(),
                      lacking_Nm),
            Status::kOk);
  EXPECT_LT((law.tension_N() - true_law.tension_N()).cwiseAbs().maxCoeff(), 0.01) << "of some 3 N";
}

// The shape that commanded tensions make, with the tensions ramped as by the controller.
TEST(EquilibriumSolver, FollowsCommandedTensions) {
  for (const char* name : {"rig_60mm", "two_section"}) {
    const RobotParameters robot = Rig(name);
    const model::Body body(robot.body);
    EquilibriumSolver law(body, robot.limits);
    const BendingVector none = BendingVector::Zero(2 * body.sections());
    TendonVector tension_N = TendonVector::Constant(body.tendons(), 0.3);
    for (int i = 0; i < 1000; ++i) {
      tension_N[1] += 0.002;
      ASSERT_TRUE(law.Follow(tension_N, none));
    }
    const auto truth = model::SolveStatics(body, tension_N, Eigen::Vector3d::Zero());
    ASSERT_EQ(truth.result, model::StaticsResult::kConverged);
    EXPECT_LT((truth.q - law.q()).cwiseAbs().maxCoeff(), 1e-6) << name;
    EXPECT_GT(truth.q.norm(), 0.1);
  }
}

// A body that its own weight buckles has no stable upright shape that tensions could hold.
TEST(EquilibriumSolver, SaysWhenThereIsNoStableShape) {
  RobotParameters robot = Rig("rig_90mm");
  robot.body.tip_payload_kg = 5;
  const model::Body body(robot.body);
  EquilibriumSolver law(body, robot.limits);
  const BendingVector us_vs = BendingVector::Zero(2);
  const TendonVector arc_N = TendonVector::Constant(3, robot.limits.min_tension_N);
  EXPECT_EQ(Solve(law, At(us_vs), arc_N, robot.limits.min_tension_N), Status::kEquilibriumNotFound);
}

ControllerParameters Equilibrium(bool feedback) {
  ControllerParameters p = kParameters;
  p.law = ControlLaw::kEquilibrium;
  p.tension_feedback = feedback;
  return p;
}

TEST(EquilibriumSolver, OneOrTwoStepsACycleSuffice) {
  const RobotParameters robot = Rig("rig_60mm");
  const model::Body body(robot.body);
  EquilibriumSolver law(body, robot.limits);
  int steps = 0;
  for (int i = 0; i < 1000; ++i) {
    const double w = 2 * std::numbers::pi, t = 1e-3 * i;
    BendingVector p(2), v(2), a(2);
    p << std::cos(w * t), std::sin(w * t);
    v << -w * std::sin(w * t), w * std::cos(w * t);
    a = -w * w * p;
    ASSERT_EQ(Solve(law, {p, v, a}, ArcTension(body, robot, p), robot.limits.min_tension_N), Status::kOk);
    if (i > 0) steps = std::max(steps, law.iterations());
  }
  EXPECT_LE(steps, 2) << "on a circle at 1 Hz";
}

// The fallback: without an equilibrium the paper's tensions are used, and said so.
TEST(EquilibriumSolver, WithoutAnEquilibriumThePaperCarriesOn) {
  RobotParameters heavy = Rig("rig_90mm");
  heavy.body.tip_payload_kg = 5;
  IdealLoop loop(heavy, Equilibrium(false));
  loop.RunUntilRunning();
  loop.Step(loop.Bending(0.05, 0));
  loop.Run(500);
  EXPECT_EQ(loop.output.mode, Mode::kRunning);
  EXPECT_EQ(loop.output.status, Status::kEquilibriumNotFound) << StatusText(loop.output.status);
  EXPECT_TRUE(loop.output.tension_desired_base_N.allFinite());
}

TEST(EquilibriumSolver, GoesOnFromASavedStateBitForBit) {
  for (const bool feedback : {false, true}) {
    IdealLoop loop(Rig("rig_60mm"), Equilibrium(feedback));
    loop.RunUntilRunning();
    loop.Step(loop.Bending(0.5, -0.3));
    loop.Run(120);
    std::vector<std::byte> state(loop.controller.state_bytes());
    loop.controller.SaveState(state);
    Controller other(loop.robot, Equilibrium(feedback), kNsPerMs);
    ASSERT_TRUE(other.LoadState(state));
    for (int i = 0; i < 300; ++i) {
      loop.Step();
      CycleOutput again;
      other.Step(loop.input, again);
      ASSERT_EQ(again.torque_target_permille, loop.output.torque_target_permille) << i;
      for (int j = 0; j < 3; ++j)
        ASSERT_EQ(again.torque_desired_Nm[j], loop.output.torque_desired_Nm[j]) << i;
    }
  }
}

TEST(EquilibriumSolver, RoundingLosesNothingInTheMeanOfAMotionAndStandsAtRest) {
  IdealLoop loop(Rig("rig_60mm"), Equilibrium(false));
  loop.RunUntilRunning();
  loop.Step(loop.Bending(0.7, 0.2));
  loop.Run(200);
  std::array<double, 3> off_permille{};
  const auto wanted_permille = [&](int j) {
    return 1e3 * loop.output.torque_desired_Nm[j] / loop.robot.actuation->tendons[j].drive.rated_torque_Nm;
  };
  for (int i = 0; i < 300; ++i) {
    loop.Step();
    for (int j = 0; j < 3; ++j) {
      off_permille[j] += loop.output.torque_target_permille[j] - wanted_permille(j);
      EXPECT_LT(std::abs(off_permille[j]), 1.01) << "of a sum over the motion";
    }
  }
  loop.Run(1500);
  const auto told = loop.output.torque_target_permille;
  for (int i = 0; i < 1000; ++i) {
    loop.Step();
    EXPECT_EQ(loop.output.torque_target_permille, told);
  }
  for (int j = 0; j < 3; ++j) EXPECT_NEAR(told[j], wanted_permille(j), 0.8);
}

// Its weight bends the units while the tip stays: that path of the tendons begins with no motion.
TEST(EquilibriumSolver, ARobotMountedSidewaysIsArmedWithoutABlow) {
  RobotParameters robot = Rig("rig_90mm");
  robot.body.gravity_W_mps2 = {9.81, 0, 0};
  IdealLoop loop(robot, Equilibrium(false));
  loop.RunUntilRunning();
  TendonVector last_Nm = loop.output.torque_desired_Nm, last_N = loop.output.tension_desired_base_N;
  for (int i = 0; i < 1000; ++i) {
    loop.Step();
    EXPECT_LT((loop.output.torque_desired_Nm - last_Nm).cwiseAbs().maxCoeff(), 1e-5) << i;
    EXPECT_LE((loop.output.tension_desired_base_N - last_N).cwiseAbs().maxCoeff(), 2e-3 + 1e-12) << i;
    last_Nm = loop.output.torque_desired_Nm;
    last_N = loop.output.tension_desired_base_N;
  }
}

}  // namespace
}  // namespace tendril::control
