// The body's effects: energies and losses of the laws, their tangents, limits and symmetries, numbers that
// are folded into the robot, and the plant at rest against the statics of the same body.
#include "../../src/sim/body_laws.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "../../src/sim/laws.h"
#include "motions.h"
#include "tendril/model/statics.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/plant.h"

namespace tendril::sim {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using std::numbers::pi;
using test::Rig;

RobotParameters With(RobotParameters robot, std::initializer_list<const char*> effects) {
  for (const char* text : effects) robot.effects.push_back(ParseEffect(text, robot));
  return robot;
}

BodyLaws LawsOf(const RobotParameters& robot) { return PlantLaws::Of(FoldEffects(robot)).body; }

/// Laws with their body and memory, moved along paths.
class Bent {
 public:
  explicit Bent(const RobotParameters& robot)
      : body(FoldEffects(robot).body),
        laws(LawsOf(robot)),
        n(body.dof()),
        m(body.tendons()),
        q(VectorXd::Zero(n)) {}

  VectorXd LawForce(const VectorXd& at) const {
    VectorXd force = VectorXd::Zero(n);
    laws.AddForce(body, at, VectorXd::Zero(n), 0, force);
    return force;
  }
  MatrixXd Lengths(const VectorXd& at) const {
    MatrixXd jacobian(m, n);
    body.TendonLengthJacobian(at, jacobian);
    return jacobian;
  }
  VectorXd TendonForce(const VectorXd& at, const VectorXd& tension) const {
    MatrixXd weighted(m, n);
    laws.WeighLengths(body, at, Lengths(at), weighted);
    return -weighted.transpose() * tension;
  }
  VectorXd Force(const VectorXd& at, const VectorXd& tension) const {
    return LawForce(at) + TendonForce(at, tension);
  }
  /// Straight to `to` in equal steps; the work that the laws' forces do on the body.
  double Move(const VectorXd& to, int steps, const VectorXd& tension) {
    double work = 0;
    const VectorXd from = q;
    for (int i = 1; i <= steps; ++i) {
      const VectorXd next = from + (to - from) * i / steps;
      const VectorXd half = 0.5 * (q + next);
      // Simpson's rule: the forces are smooth but where an element begins to slip.
      work += (Force(q, tension) + 4 * Force(half, tension) + Force(next, tension)).dot(next - q) / 6;
      laws.Commit(body, next, 0);
      q = next;
    }
    return work;
  }

  model::Body body;
  BodyLaws laws;
  int n, m;
  VectorXd q;
};

VectorXd Random(std::mt19937& random, int count, double size) {
  std::uniform_real_distribution<double> uniform(-size, size);
  VectorXd v(count);
  for (double& x : v) x = uniform(random);
  return v;
}

/// Share of base tension in every unit, M x N.
MatrixXd Shares(const Bent& bent, const VectorXd& q) {
  const MatrixXd ones = MatrixXd::Ones(bent.m, bent.n);
  MatrixXd weighted(bent.m, bent.n), share(bent.m, bent.n / 2);
  bent.laws.WeighLengths(bent.body, q, ones, weighted);
  for (int i = 0; i < bent.n / 2; ++i) share.col(i) = weighted.col(2 * i);
  return share;
}

// ---- the collection ----

TEST(BodyLaws, NominalValuesAddNothing) {
  for (const char* effect : {"backbone_hysteresis moment_Nm=0", "superelastic softening=0",
                             "routing_friction mu=0", "contact stiffness_Npm=0"}) {
    EXPECT_TRUE(LawsOf(With(Rig(), {effect})).empty()) << effect;
  }
}

TEST(BodyLaws, ACopyGoesItsOwnWay) {
  Bent bent(With(Rig(), {"backbone_hysteresis moment_Nm=0.001", "routing_friction mu=0.2"}));
  const VectorXd there = VectorXd::Constant(8, 0.2), tension = VectorXd::Ones(3);
  bent.Move(there, 20, tension);
  Bent copy = bent;
  EXPECT_EQ(copy.Force(0.9 * there, tension), bent.Force(0.9 * there, tension));
  const VectorXd before = bent.Force(0.9 * there, tension);
  copy.Move(-there, 20, tension);
  EXPECT_EQ(bent.Force(0.9 * there, tension), before);
  EXPECT_NE(copy.Force(0.9 * there, tension), before);
}

TEST(BodyLaws, PeekingMovesNoMemory) {
  Bent bent(With(Rig(), {"backbone_hysteresis moment_Nm=0.001", "routing_friction mu=0.2"}));
  const VectorXd q = VectorXd::Constant(8, 0.02), tension = VectorXd::Ones(3);
  const VectorXd before = bent.Force(q, tension);
  bent.Force(VectorXd::Constant(8, -1), tension);
  EXPECT_EQ(bent.Force(q, tension), before);
}

// ---- forces that come from an energy ----

TEST(BodyLaws, ElasticLawsGiveBackWhatTheyTookOnAnyClosedPath) {
  for (const char* effect :
       {"superelastic softening=0.5 onset_rad=0.2", "contact stiffness_Npm=300 gap_m=0.004 angle_rad=0.5"}) {
    for (const char* file : {"rig_60mm", "two_section"}) {
      Bent bent(With(Rig(file), {effect}));
      std::mt19937 random(4);
      const VectorXd start = Random(random, bent.n, 0.3), none = VectorXd::Zero(bent.m);
      bent.Move(start, 1, none);
      double sum = 0, moved = 0;
      for (int k = 0; k < 4; ++k) {
        const double part = bent.Move(k < 3 ? Random(random, bent.n, 0.5) : start, 3000, none);
        sum += part;
        moved += std::abs(part);
      }
      EXPECT_GT(moved, 1e-5) << effect;
      EXPECT_LT(std::abs(sum), 1e-7 * moved) << effect << " " << file;
    }
  }
}

TEST(Superelastic, TangentFallsFromTheUnitsStiffnessToItsFloor) {
  const double softening = 0.4, onset = 0.25;
  Bent bent(With(Rig(), {"superelastic softening=0.4 onset_rad=0.25", "unit_stiffness where=unit:2 scale=0.8",
                         "precurvature where=unit:2 u_rad=0.1 v_rad=0.05"}));
  const double k = bent.body.unit_stiffness_Nm(1);
  EXPECT_NEAR(k, 0.8 * bent.body.unit_stiffness_Nm(0), 1e-15);
  for (const double theta : {0.0, 0.001, 0.1, onset, 0.6, 3.0}) {
    VectorXd q = VectorXd::Zero(8);
    q.segment<2>(2) = Vector2d(0.1, 0.05) + theta * Vector2d(0.6, -0.8);
    VectorXd holds(8);  // elastic moment of the linear unit less that of the law
    holds.setZero();
    holds.segment<2>(2) = k * theta * Vector2d(0.6, -0.8) - bent.LawForce(q).segment<2>(2);
    const double moment = k * ((1 - softening) * theta + softening * onset * std::tanh(theta / onset));
    EXPECT_NEAR(holds.segment<2>(2).dot(Vector2d(0.6, -0.8)), moment, 1e-15);
    EXPECT_NEAR(holds.segment<2>(2).dot(Vector2d(0.8, 0.6)), 0, 1e-17);
    MatrixXd tangent = MatrixXd::Zero(8, 8);
    bent.laws.AddStiffness(bent.body, q, VectorXd::Zero(3), tangent);
    const double along = Vector2d(0.6, -0.8).dot(tangent.block<2, 2>(2, 2) * Vector2d(0.6, -0.8));
    EXPECT_NEAR(along, -k * softening * std::pow(std::tanh(theta / onset), 2), 1e-14);
  }
}

TEST(Contact, TouchesNothingBeforeTheWallAndPushesBackBehindIt) {
  Bent bent(With(Rig(), {"contact stiffness_Npm=200 gap_m=0.01 angle_rad=1"}));
  const Vector2d towards(std::cos(1.0), std::sin(1.0));
  VectorXd q(8);
  for (int i = 0; i < 4; ++i) q.segment<2>(2 * i) = 0.05 * towards;
  EXPECT_LT(bent.body.TipPose(q).p_WA.head<2>().dot(towards), 0.01);
  EXPECT_EQ(bent.LawForce(q), VectorXd::Zero(8));
  EXPECT_EQ(bent.LawForce(-10 * q), VectorXd::Zero(8));
  // Only the last disk is behind the wall: a force of k (depth - edge / 2) on the tip, across the wall.
  for (int i = 0; i < 4; ++i) q.segment<2>(2 * i) = 0.08 * towards;
  const Vector3d tip = bent.body.TipPose(q).p_WA;
  const double depth = tip.head<2>().dot(towards) - 0.01;
  ASSERT_GT(depth, 3e-4);
  const Vector3d push(-200 * (depth - 1e-4) * towards.x(), -200 * (depth - 1e-4) * towards.y(), 0);
  MatrixXd jacobian(6, 8);
  bent.body.TipJacobian(q, jacobian);
  EXPECT_LT((bent.LawForce(q) - jacobian.topRows(3).transpose() * push).norm(), 1e-15);
}

// ---- hysteresis of the backbone ----

TEST(BackboneHysteresis, HoldsWithItsMomentAgainstTheMotionWhateverTheDirection) {
  for (const double direction : {0.0, 0.7, 2.5}) {
    Bent bent(With(Rig(), {"backbone_hysteresis moment_Nm=0.002 yield_rad=0.04"}));
    VectorXd there = VectorXd::Zero(8);
    const Vector2d e(std::cos(direction), std::sin(direction));
    there.segment<2>(4) = 0.5 * e;
    const VectorXd none = VectorXd::Zero(3);
    bent.Move(there, 50, none);
    EXPECT_LT((bent.LawForce(bent.q).segment<2>(4) + 0.002 * e).norm(), 1e-16);
    EXPECT_EQ(bent.LawForce(bent.q).head(4), VectorXd::Zero(4));
    // Turned round within twice the yield.
    there.segment<2>(4) = 0.41 * e;
    bent.Move(there, 50, none);
    EXPECT_LT((bent.LawForce(bent.q).segment<2>(4) - 0.002 * e).norm(), 1e-16);
  }
}

TEST(BackboneHysteresis, OnlyItsSectionHasIt) {
  Bent bent(With(Rig("two_section"), {"backbone_hysteresis where=section:2 moment_Nm=0.002"}));
  const int first = 2 * bent.body.first_unit(1);
  const VectorXd force = bent.LawForce(VectorXd::Constant(bent.n, 0.3));
  EXPECT_EQ(force.head(first), VectorXd::Zero(first));
  EXPECT_LT(force.tail(bent.n - first).maxCoeff(), -1e-3);
}

TEST(BackboneHysteresis, NeverGivesMoreThanItTook) {
  std::mt19937 random(6);
  for (int trial = 0; trial < 20; ++trial) {
    Bent bent(With(Rig(), {"backbone_hysteresis moment_Nm=0.002 yield_rad=0.05"}));
    double work = 0;  // of the law on the body, from a relaxed start: what it stores and loses, negative
    const double size = trial % 2 ? 0.02 : 0.3;
    for (int k = 0; k < 12; ++k) {
      work += bent.Move(Random(random, 8, size), 200, VectorXd::Zero(3));
      EXPECT_LT(work, 1e-12);
    }
  }
}

TEST(BackboneHysteresis, LoopLosesTheSameAtAnySpeedAndStep) {
  struct Spread {
    const char* effect;
    double mean;  // of the springs' yields, (k/4)^spread, of the whole one
  };
  for (const Spread& spread :
       {Spread{"backbone_hysteresis moment_Nm=0.002 yield_rad=0.05", 0.625},
        Spread{"backbone_hysteresis moment_Nm=0.002 yield_rad=0.05 spread=2", 0.46875},
        Spread{"backbone_hysteresis moment_Nm=0.002 yield_rad=0.05 spread=0.5", 0.768283}}) {
    double lost[2];
    for (int k = 0; k < 2; ++k) {
      Bent bent(With(Rig(), {spread.effect}));
      const VectorXd a = VectorXd::Unit(8, 2) * 0.4, none = VectorXd::Zero(3);
      bent.Move(a, 4000, none);
      lost[k] = -bent.Move(-a, k ? 4000 : 13600, none) - bent.Move(a, k ? 4000 : 13600, none);
    }
    EXPECT_NEAR(lost[0], lost[1], 1e-6 * lost[0]);
    // There and back over 0.8 rad at the full moment, less the mean yield at each turn.
    EXPECT_NEAR(lost[0], 2 * 0.002 * (0.8 - 2 * spread.mean * 0.05), 1e-6 * lost[0]) << spread.effect;
  }
}

// ---- friction along the disks ----

TEST(RoutingFriction, APulledTendonLosesAndAReleasedOneKeepsAsOnACapstan) {
  const double mu = 0.15, bend = 0.3;
  for (const double sign : {1.0, -1.0}) {
    Bent bent(With(Rig(), {"routing_friction mu=0.15"}));
    VectorXd q = VectorXd::Zero(8);
    for (int i = 0; i < 4; ++i) q[2 * i] = sign * bend;  // towards tendon 1, or away from it
    bent.Move(q, 50, VectorXd::Zero(3));
    const MatrixXd share = Shares(bent, q);
    for (int i = 0; i < 4; ++i) {
      EXPECT_NEAR(share(0, i), std::exp(-sign * mu * bend * i), 1e-12);
      EXPECT_NEAR(share(1, i), std::exp(sign * mu * bend * i), 1e-12);
      EXPECT_NEAR(share(2, i), share(1, i), 1e-15);
    }
  }
}

TEST(RoutingFriction, OnlyTheTendonNamedRubs) {
  Bent bent(With(Rig(), {"routing_friction where=tendon:2 mu=0.15"}));
  const VectorXd q = VectorXd::Constant(8, 0.2);
  bent.Move(q, 50, VectorXd::Zero(3));
  const MatrixXd share = Shares(bent, q);
  EXPECT_EQ(share.row(0), Eigen::RowVectorXd::Ones(4));
  EXPECT_EQ(share.row(2), Eigen::RowVectorXd::Ones(4));
  EXPECT_GT((share.row(1).array() - 1).abs().maxCoeff(), 0.01);
}

TEST(RoutingFriction, WithoutItTheWeightedLengthsAreTheLengths) {
  Bent bent(With(Rig(), {"backbone_hysteresis moment_Nm=0.001"}));
  const VectorXd q = VectorXd::Constant(8, 0.2);
  MatrixXd weighted(3, 8);
  bent.laws.WeighLengths(bent.body, q, bent.Lengths(q), weighted);
  EXPECT_EQ(weighted, bent.Lengths(q));
}

// The base does no net work at constant tensions on a closed path; what the body is not given, friction took.
TEST(RoutingFriction, TakesWorkOnEveryClosedPath) {
  std::mt19937 random(9);
  for (const char* file : {"rig_90mm", "two_section"}) {
    for (int trial = 0; trial < 6; ++trial) {
      Bent bent(With(Rig(file), {"routing_friction mu=0.2"}));
      VectorXd tension = Random(random, bent.m, 2);
      tension.array() += 2.5;
      const VectorXd start = Random(random, bent.n, 0.4);
      bent.Move(start, 200, tension);
      double work = 0;
      for (int k = 0; k < 4; ++k) {
        work += bent.Move(k < 3 ? Random(random, bent.n, 0.4) : start, 300, tension);
      }
      EXPECT_LT(work, -1e-4) << file;
    }
  }
}

TEST(RoutingFriction, TheMirrorImageRubsAsTheMirrorImage) {
  Bent bent(With(Rig(), {"routing_friction mu=0.2"})), image = bent;
  std::mt19937 random(3);
  VectorXd mirror = VectorXd::Ones(8);
  for (int i = 1; i < 8; i += 2) mirror[i] = -1;
  for (int k = 0; k < 5; ++k) {  // plane y = 0: tendons 2 and 3 change places
    const VectorXd q = Random(random, 8, 0.4), tension = Vector3d(3, 1, 2), swapped = Vector3d(3, 2, 1);
    bent.Move(q, 20, tension);
    image.Move(mirror.cwiseProduct(q), 20, swapped);
    EXPECT_LT(
        (mirror.cwiseProduct(image.TendonForce(image.q, swapped)) - bent.TendonForce(q, tension)).norm(),
        1e-14);
  }
}

TEST(RoutingFriction, TwistedHolesRubEvenWhenStraight) {
  Bent bent(With(Rig(), {"routing_friction mu=0.2", "torsion rad_per_m=10"}));
  VectorXd q = VectorXd::Zero(8);
  q[6] = 0.02;  // the last unit alone moves, towards tendon 1, and draws it over disks that are all straight
  bent.Move(q, 20, VectorXd::Zero(3));
  const MatrixXd share = Shares(bent, q);
  // Turn of a helix of radius r and pitch angle: about r twist^2 l at a disk.
  EXPECT_NEAR(-std::log(share(0, 1)), 0.2 * 0.004 * 100 * 0.0225, 0.02 * 0.2 * 0.004 * 100 * 0.0225);
}

// ---- tangents ----

// At points where no memory just turns; the hints of friction and contact leave small parts out and say so.
TEST(BodyLaws, StiffnessIsTheSlopeOfTheForces) {
  struct Case {
    const char* effect;
    double tolerance;
  };
  for (const auto& [effect, tolerance] :
       {Case{"superelastic softening=0.6 onset_rad=0.2", 1e-8},
        Case{"backbone_hysteresis moment_Nm=0.003 yield_rad=0.1", 1e-8},
        // Differences over 1e-6 of a yield of 1.6e-3 rad are that far from the slope.
        Case{"backbone_hysteresis moment_Nm=0.003 yield_rad=0.1 spread=3", 4e-7},
        Case{"routing_friction mu=0.2", 0.03}, Case{"contact stiffness_Npm=500 gap_m=0.002", 0.03}}) {
    for (const char* file : {"rig_90mm", "two_section"}) {
      Bent bent(With(Rig(file), {effect}));
      std::mt19937 random(12);
      const VectorXd tension = VectorXd::Constant(bent.m, 2);
      bent.Move(Random(random, bent.n, 0.2), 10, tension);
      double checked = 0;
      for (int k = 0; k < 20; ++k) {
        // Near the memory, so that some elements stick and some slip.
        const VectorXd q = bent.q + Random(random, bent.n, k % 2 ? 0.05 : 0.001);
        const MatrixXd lengths = bent.Lengths(q);
        const auto force = [&](const VectorXd& at) {
          MatrixXd weighted(bent.m, bent.n);  // through the shares alone
          bent.laws.WeighLengths(bent.body, at, lengths, weighted);
          return VectorXd(bent.LawForce(at) - weighted.transpose() * tension);
        };
        MatrixXd stiffness = MatrixXd::Zero(bent.n, bent.n), slope(bent.n, bent.n), coarse(bent.n, bent.n);
        bent.laws.AddStiffness(bent.body, q, tension, stiffness);
        for (int i = 0; i < bent.n; ++i) {
          const VectorXd e = VectorXd::Unit(bent.n, i);
          slope.col(i) = -(force(q + 1e-6 * e) - force(q - 1e-6 * e)) / 2e-6;
          coarse.col(i) = -(force(q + 3e-6 * e) - force(q - 3e-6 * e)) / 6e-6;
        }
        if ((slope - coarse).norm() > 1e-4 * slope.norm()) continue;  // a corner lies between
        ++checked;
        EXPECT_LE((stiffness - slope).norm(), tolerance * (1e-3 + slope.norm())) << effect << " " << file;
      }
      EXPECT_GT(checked, 5) << effect;
    }
  }
}

// ---- numbers of the robot ----

TEST(BodyEffects, AreTheNumbersTheyAreCalled) {
  const RobotParameters nominal = Rig("two_section");
  const auto body = [&](const char* effect) { return FoldEffects(With(nominal, {effect})).body; };
  const auto& was = nominal.body;
  EXPECT_EQ(body("bending_stiffness where=section:2 scale=0.9").sections[1].youngs_modulus_Pa,
            0.9 * was.sections[1].youngs_modulus_Pa);
  EXPECT_EQ(body("bending_stiffness where=section:2 scale=0.9").sections[0].youngs_modulus_Pa,
            was.sections[0].youngs_modulus_Pa);
  const model::Body soft(body("unit_stiffness where=unit:3 scale=0.7")), plain(was);
  for (int i = 0; i < plain.units(); ++i) {
    EXPECT_EQ(soft.unit_stiffness_Nm(i), (i == 2 ? 0.7 : 1) * plain.unit_stiffness_Nm(i));
  }
  const model::Body bent(body("precurvature u_rad=0.02 v_rad=-0.01"));
  for (int i = 0; i < plain.units(); ++i) EXPECT_EQ(bent.rest_bend_rad(i), Vector2d(0.02, -0.01));
  EXPECT_EQ(body("bending_damping scale=3").sections[0].bending_damping_Nms,
            3 * was.sections[0].bending_damping_Nms);
  const int second = static_cast<int>(was.sections[0].tendons.size());
  const std::string tendon = "where=tendon:" + std::to_string(second + 1);
  EXPECT_EQ(body(("hole_radius " + tendon + " scale=1.1").c_str()).sections[1].tendons[0].radius_m,
            1.1 * was.sections[1].tendons[0].radius_m);
  EXPECT_EQ(body(("hole_radius " + tendon + " scale=1.1").c_str()).sections[0].tendons[0].radius_m,
            was.sections[0].tendons[0].radius_m);
  EXPECT_EQ(body("hole_angle rad=0.1").sections[1].tendons[2].angle_rad,
            was.sections[1].tendons[2].angle_rad + 0.1);
  EXPECT_EQ(body("unit_length scale=1.02").length_m(), model::Body(was).parameters().length_m() * 1.02);
  const auto heavy = body("unit_mass where=section:1 scale=2");
  EXPECT_EQ(heavy.sections[0].unit_mass_kg, 2 * was.sections[0].unit_mass_kg);
  EXPECT_EQ(heavy.sections[0].disk_inertia_zz_kgm2, 2 * was.sections[0].disk_inertia_zz_kgm2);
  EXPECT_EQ(heavy.sections[1].unit_mass_kg, was.sections[1].unit_mass_kg);
  EXPECT_EQ(body("tip_payload mass_kg=0.003").tip_payload_kg, 0.003);
  EXPECT_EQ(body("tip_force x_N=0.1 z_N=-0.2").tip_force_W_N, Vector3d(0.1, 0, -0.2));
  EXPECT_EQ(body("torsion rad_per_m=2").twist_rad_per_m, 2);
}

TEST(BaseTilt, ATiltedRobotLeansAsItsAxisDoes) {
  // Turned about +x its axis leans towards -y of the room; seen from the base, gravity does.
  const auto gravity = FoldEffects(With(Rig(), {"base_tilt x_rad=0.1"})).body.gravity_W_mps2;
  EXPECT_LT((gravity - 9.81 * Vector3d(0, -std::sin(0.1), -std::cos(0.1))).norm(), 1e-14);
  const model::Body body(FoldEffects(With(Rig(), {"base_tilt x_rad=0.1"})).body);
  const auto rest = model::SolveStatics(body, Vector3d(0.3, 0.3, 0.3), Vector3d::Zero());
  EXPECT_LT(body.TipPose(rest.q).p_WA.y(), -1e-5);
  EXPECT_NEAR(body.TipPose(rest.q).p_WA.x(), 0, 1e-12);
  EXPECT_NEAR(FoldEffects(With(Rig(), {"base_tilt x_rad=0.3 y_rad=-0.5"})).body.gravity_W_mps2.norm(), 9.81,
              1e-14);
}

// ---- the plant ----

/// Torques for a pull to some 6 N and back to 4.5 N, then a hold; no tendon gets slack.
VectorXd PullAndHold(const RobotParameters& robot, double t) {
  const double pull_N = t < 1 ? 1 + 5 * t : std::max(4.5, 6 - 2 * (t - 1));
  VectorXd torque(robot.body.tendons());
  for (int j = 0; j < torque.size(); ++j) {
    torque[j] = robot.actuation->tendons[static_cast<std::size_t>(j)].SpoolTravelPerMotorRad() *
                (j % 3 == 0 ? pull_N : 0.8 + 0.3 * (j % 3));
  }
  return torque;
}

/// Moves so until it is at rest; the laws follow in a copy.
struct AtRest {
  VectorXd q, tension;
  double left_Nm;  // of the balance of static, tendons' and laws' forces
  double sped;
};
AtRest Settle(const RobotParameters& robot, const PlantOptions& options = {}) {
  Plant plant(robot, options);
  Bent bent(robot);
  for (int ms = 0; ms < 5000; ++ms) {
    const double t = 1e-3 * ms;
    plant.SetTorque(PullAndHold(robot, t));
    plant.Advance(kNsPerMs);
    bent.laws.Commit(bent.body, plant.q(), t);
  }
  AtRest rest{plant.q(), VectorXd(bent.m), 0, plant.dq().norm()};
  for (int j = 0; j < bent.m; ++j)
    rest.tension[j] = plant.tendon()[static_cast<std::size_t>(j)].tension_base_N;
  VectorXd held(bent.n);
  bent.body.StaticForce(rest.q, Vector3d::Zero(), held);
  rest.left_Nm = (held - bent.Force(rest.q, rest.tension)).cwiseAbs().maxCoeff();
  return rest;
}

TEST(PlantWithBodyEffects, SettlesWhereTheBodyAsBuiltIsInEquilibrium) {
  for (const char* file : {"rig_90mm", "two_section"}) {
    const RobotParameters robot =
        With(Rig(file), {"tip_payload mass_kg=0.002", "tip_force x_N=0.01", "torsion rad_per_m=3",
                         "unit_stiffness where=unit:2 scale=0.8", "precurvature where=unit:3 v_rad=0.05",
                         "base_tilt y_rad=0.1", "hole_radius where=tendon:1 scale=1.05"});
    const AtRest rest = Settle(robot);
    ASSERT_LT(rest.sped, 1e-5) << file;
    const model::Body body(FoldEffects(robot).body);
    const auto found = model::SolveStatics(body, rest.tension, Vector3d::Zero());
    ASSERT_EQ(found.result, model::StaticsResult::kConverged);
    EXPECT_LT((found.q - rest.q).cwiseAbs().maxCoeff(), 1e-5) << file;
  }
}

TEST(PlantWithBodyEffects, SettlesInTheBalanceOfItsLaws) {
  const VectorXd nominal = Settle(Rig()).q;
  for (const char* effect :
       {"superelastic softening=0.4 onset_rad=0.1", "backbone_hysteresis moment_Nm=0.001",
        "routing_friction mu=0.15", "contact stiffness_Npm=100 gap_m=0.01"}) {
    const AtRest rest = Settle(With(Rig(), {effect}));
    EXPECT_LT(rest.sped, 1e-4) << effect;
    EXPECT_LT(rest.left_Nm, 1e-6) << effect;  // of moments of 1e-2
    EXPECT_GT((rest.q - nominal).norm(), 0.005) << effect;
  }
}

struct SolverError {
  double cell_N = 0, tip_m = 0;  // rms, beside a hundred times tighter tolerances
};
SolverError ErrorOf(const RobotParameters& robot) {
  const test::CircleTorque circle(robot);
  Plant plant(robot), exact(robot, {.relative_tolerance = 1e-9, .absolute_tolerance = 3e-10});
  SolverError sum;
  constexpr int kMilliseconds = 6000;
  for (int ms = 0; ms < kMilliseconds; ++ms) {
    for (Plant* p : {&plant, &exact}) {
      p->SetTorque(circle.At(1e-3 * ms));
      p->Advance(kNsPerMs);
    }
    sum.tip_m += (plant.TipPose().p_WA - exact.TipPose().p_WA).squaredNorm();
    for (std::size_t j = 0; j < 3; ++j) {
      sum.cell_N += std::pow(plant.tendon()[j].tension_motor_N - exact.tendon()[j].tension_motor_N, 2) / 3;
    }
  }
  return {std::sqrt(sum.cell_N / kMilliseconds), std::sqrt(sum.tip_m / kMilliseconds)};
}

// The circle lets tendons go slack and motors turn round, which carries errors on; the laws must not add any.
TEST(PlantWithBodyEffects, IsSolvedAsWellAsTheNominalPlant) {
  const SolverError nominal = ErrorOf(Rig());
  const SolverError with_laws = ErrorOf(
      With(Rig(), {"backbone_hysteresis moment_Nm=0.001", "routing_friction mu=0.15",
                   "superelastic softening=0.3 onset_rad=0.2", "contact stiffness_Npm=100 gap_m=0.02"}));
  EXPECT_LT(with_laws.cell_N, 2 * nominal.cell_N);
  EXPECT_LT(with_laws.tip_m, 2 * nominal.tip_m);
  EXPECT_LT(with_laws.tip_m, 0.1 * 5e-5);  // of the tracker's noise
}

}  // namespace
}  // namespace tendril::sim
