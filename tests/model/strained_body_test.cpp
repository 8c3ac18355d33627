// What must hold of bodies that bend, twist and stretch, over random robots: forces, energies and shapes
// agree, symmetry, and the limits in which they are the body that only bends.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <unsupported/Eigen/MatrixFunctions>

#include "bodies.h"
#include "tendril/model/body.h"
#include "tendril/model/shape_points.h"
#include "tendril/model/simulate.h"
#include "tendril/model/statics.h"

namespace tendril::model {
namespace {

using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Eigen::VectorXd;
using test::Random;

// Sixth-order central difference of a vector function at 0.
VectorXd SlopeAt0(const std::function<VectorXd(double)>& f, double h) {
  return (45 * (f(h) - f(-h)) - 9 * (f(2 * h) - f(-2 * h)) + (f(3 * h) - f(-3 * h))) / (60 * h);
}

MatrixXd Differences(const std::function<VectorXd(const VectorXd&)>& f, const VectorXd& q, double h = 1e-2) {
  MatrixXd slopes(f(q).size(), q.size());
  for (Eigen::Index i = 0; i < q.size(); ++i)
    slopes.col(i) = SlopeAt0([&](double s) { return f(q + s * VectorXd::Unit(q.size(), i)); }, h);
  return slopes;
}

class StrainedBody : public testing::TestWithParam<unsigned> {
 protected:
  StrainedBody()
      : parameters(test::RandomStrained(GetParam())),
        body(parameters),
        workspace(body),
        n(body.dof()),
        m(body.tendons()),
        random(GetParam() + 100) {}

  // Strains up to 1 rad of each unit and 10 % of its length; every fourth shape is almost straight.
  VectorXd Shape(int k, double scale = 1) {
    VectorXd q(n);
    for (int i = 0; i < body.units(); ++i) {
      const int at = body.coordinate(i);
      const int turns = body.twists(i) ? 3 : 2;
      const int others = (body.stretches(i) ? 1 : 0) + (body.shears(i) ? 2 : 0);
      for (int a = 0; a < turns + others; ++a) q[at + a] = random.Uniform(-1, 1) * (a < turns ? 1 : 0.1);
    }
    return q * (k % 4 == 3 ? 1e-5 : scale);
  }
  VectorXd TendonForce(const VectorXd& q, const VectorXd& tension) const {
    VectorXd force(n);
    body.TendonForce(q, tension, force);
    return force;
  }
  VectorXd Inverse(const VectorXd& q, const VectorXd& dq, const VectorXd& ddq) {
    VectorXd force(n);
    body.InverseDynamics(q, dq, ddq, force, workspace);
    return force;
  }
  VectorXd Forward(const VectorXd& q, const VectorXd& dq, const VectorXd& force) {
    VectorXd ddq(n);
    body.ForwardDynamics(q, dq, force, ddq, workspace);
    return ddq;
  }

  BodyParameters parameters;
  Body body;
  Body::Workspace workspace;
  int n, m;
  Random random;
};

TEST_P(StrainedBody, MassMatrixIsWhatAccelerationsNeedAndWhatMovesCarries) {
  const VectorXd rest = VectorXd::Zero(n);
  MatrixXd mass(n, n);
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -20, 20);
    body.MassMatrix(q, mass, workspace);
    EXPECT_EQ((mass - mass.transpose()).cwiseAbs().maxCoeff(), 0);
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(mass).eigenvalues()[0], 0);
    const VectorXd still = Inverse(q, rest, rest);
    for (int i = 0; i < n; ++i) {
      const VectorXd column = (Inverse(q, rest, 1e6 * VectorXd::Unit(n, i)) - still) / 1e6;
      EXPECT_LT((column - mass.col(i)).norm(), 1e-12 * mass.col(i).norm());
    }
    const double kinetic = body.EnergyOf(q, dq, workspace).kinetic;
    EXPECT_NEAR(0.5 * dq.dot(mass * dq), kinetic, 1e-12 * kinetic);
  }
}

TEST_P(StrainedBody, ForwardUndoesInverse) {
  for (int k = 0; k < 8; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -20, 20), ddq = random.Vector(n, -1e4, 1e4);
    EXPECT_LT((Forward(q, dq, Inverse(q, dq, ddq)) - ddq).norm(), 1e-8 * ddq.norm());
  }
}

TEST_P(StrainedBody, PowerOfTheForcesIsTheChangeOfEnergyPlusWhatDampingTakes) {
  BodyParameters drawn = parameters;
  for (SectionParameters& s : drawn.sections)
    s.bending_damping_Nms = s.torsional_damping_Nms = s.axial_damping_Nspm = s.shear_damping_Nspm = 0;
  const Body undamped(drawn);
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -5, 5), force = random.Vector(n, -0.02, 0.02);
    const VectorXd ddq = Forward(q, dq, force);
    const double rate = SlopeAt0(
        [&](double t) {
          const VectorXd at = q + t * dq + 0.5 * t * t * ddq, speed = dq + t * ddq;
          return VectorXd::Constant(1, body.EnergyOf(at, speed, workspace).total());
        },
        2e-7)[0];
    VectorXd without(n);
    undamped.InverseDynamics(q, dq, ddq, without, workspace);
    const double lost = (force - without).dot(dq), power = force.dot(dq);
    EXPECT_GE(lost, 0);
    EXPECT_NEAR(rate + lost, power, 1e-6 * force.cwiseAbs().dot(dq.cwiseAbs()));
  }
}

TEST_P(StrainedBody, TendonForceIsMinusTheGradientOfTensionTimesLength) {
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k), tension = random.Vector(m, 0, 8);
    VectorXd shortening(m), same(m), straight(m), length(m);
    MatrixXd jacobian(m, n), spans(m, body.disks());
    body.TendonShortening(q, shortening, jacobian);
    body.TendonShortening(q, same);
    body.SpanShortening(q, spans);
    body.TendonLengths(VectorXd::Zero(n), straight);
    body.TendonLengths(q, length);
    const MatrixXd differences = Differences(
        [&](const VectorXd& at) {
          VectorXd l(m);
          body.TendonLengths(at, l);
          return l;
        },
        q);
    EXPECT_LT((jacobian - differences).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_LT((TendonForce(q, tension) + jacobian.transpose() * tension).norm(), 1e-14);
    EXPECT_LT((straight - length - shortening).cwiseAbs().maxCoeff(), 1e-16);
    EXPECT_LT((same - shortening).cwiseAbs().maxCoeff(), 1e-17);
    EXPECT_LT((spans.rowwise().sum() - shortening).norm(), 1e-16);
  }
}

// From the holes' places alone: no unit between two disks touches a tendon.
TEST_P(StrainedBody, TendonsRunStraightFromDiskToDisk) {
  VectorXd length(m);
  MatrixXd turns(m, body.disks());
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k);
    body.TendonLengths(q, length);
    body.TendonTurns(q, turns);
    for (int j = 0; j < m; ++j) {
      const Eigen::Matrix3Xd holes = TendonHoles(body, q, j);
      double total_m = 0;
      for (Eigen::Index i = 1; i < holes.cols(); ++i) {
        const Vector3d span = holes.col(i) - holes.col(i - 1);
        total_m += span.norm();
        if (i + 1 == holes.cols()) continue;
        const Vector3d next = holes.col(i + 1) - holes.col(i);
        EXPECT_NEAR(turns(j, i - 1), 2 * std::asin(0.5 * (span.normalized() - next.normalized()).norm()),
                    1e-13);
      }
      EXPECT_NEAR(length[j], total_m, 1e-15);
    }
  }
}

TEST_P(StrainedBody, TangentStiffnessIsTheDerivativeOfTheStaticForces) {
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k), tension = random.Vector(m, 0, 8);
    const TipWrench tip{random.Vector(3, -0.3, 0.3),
                        k % 2 == 0 ? Vector3d(random.Vector(3, -0.02, 0.02)) : Vector3d(0, 0, 0)};
    MatrixXd stiffness(n, n);
    body.TangentStiffness(q, tension, tip, stiffness);
    const MatrixXd differences = Differences(
        [&](const VectorXd& at) {
          VectorXd held(n);
          body.StaticForce(at, tip, held);
          return VectorXd(held - TendonForce(at, tension));
        },
        q, 5e-3);
    EXPECT_LT((stiffness - differences).cwiseAbs().maxCoeff(), 1e-11 * stiffness.cwiseAbs().maxCoeff());
    if (k % 2 == 1) {
      EXPECT_EQ((stiffness - stiffness.transpose()).cwiseAbs().maxCoeff(), 0);
    }
  }
}

TEST_P(StrainedBody, StaticForceIsTheInverseDynamicsAtRestLessTheWrenchsShare) {
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k), rest = VectorXd::Zero(n);
    const TipWrench tip{random.Vector(3, -0.3, 0.3), random.Vector(3, -0.02, 0.02)};
    MatrixXd jacobian(6, n);
    body.TipJacobian(q, jacobian);
    VectorXd held(n), wrench(6);
    wrench << tip.force_W_N, tip.moment_W_Nm;
    body.StaticForce(q, tip, held);
    EXPECT_LT((held - Inverse(q, rest, rest) + jacobian.transpose() * wrench).norm(), 1e-14);
    VectorXd elastic(n), free(n);
    body.ElasticForce(q, elastic);
    BodyParameters weightless = parameters;
    weightless.gravity_W_mps2.setZero();
    weightless.tip_force_W_N.setZero();
    Body(weightless).StaticForce(q, {}, free);
    EXPECT_LT((elastic - free).norm(), 1e-15 * (1 + elastic.norm()));
  }
}

TEST_P(StrainedBody, TipJacobianIsTheDerivativeOfTheTipPose) {
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k);
    MatrixXd jacobian(6, n);
    body.TipJacobian(q, jacobian);
    const Pose here = body.TipPose(q);
    const MatrixXd differences = Differences(
        [&](const VectorXd& at) {
          const Pose pose = body.TipPose(at);
          VectorXd flat(12);
          flat << pose.p_WA, pose.R_WA.reshaped();
          return flat;
        },
        q);
    EXPECT_LT((jacobian.topRows(3) - differences.topRows(3)).cwiseAbs().maxCoeff(), 1e-12);
    for (int i = 0; i < n; ++i) {
      const Eigen::Matrix3d rate =
          Eigen::Map<const Eigen::Matrix3d>(VectorXd(differences.col(i).tail(9)).data());
      const Eigen::Matrix3d spin = rate * here.R_WA.transpose();
      EXPECT_LT((Vector3d(spin(2, 1), spin(0, 2), spin(1, 0)) - jacobian.col(i).tail<3>()).norm(), 1e-10);
    }
  }
}

// Against the matrix exponential of the strain, from straight to a turn by 3 rad.
TEST_P(StrainedBody, AUnitsEndIsTheExponentialOfItsStrain) {
  for (int k = 0; k < 8; ++k) {
    const VectorXd q = Shape(k, 1.8);
    Matrix4d chain = Matrix4d::Identity();
    std::vector<Pose> poses(static_cast<std::size_t>(body.units()));
    body.Poses(q, poses);
    for (int s = 0; s < body.sections(); ++s) {
      for (int i = body.first_unit(s); i < body.end_unit(s); ++i) {
        const StrainVector strain = body.StrainsOf(i, q);
        Matrix4d xi = Matrix4d::Zero();
        const Vector3d phi(-strain[1], strain[0], strain[2]);
        xi.topLeftCorner<3, 3>() << 0, -phi[2], phi[1], phi[2], 0, -phi[0], -phi[1], phi[0], 0;
        xi.topRightCorner<3, 1>() = parameters.sections[static_cast<std::size_t>(s)].unit_length_m *
                                    Vector3d(strain[4], strain[5], 1 + strain[3]);
        const Matrix4d half = (0.5 * xi).exp(), before = chain;
        chain = before * xi.exp();
        const Pose& end = poses[static_cast<std::size_t>(i)];
        EXPECT_LT((end.R_WA - chain.topLeftCorner<3, 3>()).norm(), 1e-13);
        EXPECT_LT((end.p_WA - chain.topRightCorner<3, 1>()).norm(), 1e-15);
        const Pose middle = body.PoseWithin(i, q, 0.5);
        EXPECT_LT((middle.p_WA - half.topRightCorner<3, 1>()).norm(), 1e-15);
        EXPECT_LT((middle.R_WA - half.topLeftCorner<3, 3>()).norm(), 1e-14);
      }
    }
    EXPECT_EQ(poses.back().p_WA, body.TipPose(q).p_WA);
  }
}

// Robot, gravity and motion turned about z by `angle`: everything turns with them; torsion and extension
// stay.
TEST_P(StrainedBody, NothingChangesWhenEverythingTurnsAboutZ) {
  const double angle = 0.7;
  BodyParameters turned_parameters = parameters;
  const Eigen::AngleAxisd about_z(angle, Vector3d::UnitZ());
  turned_parameters.gravity_W_mps2 = about_z * parameters.gravity_W_mps2;
  turned_parameters.tip_force_W_N = about_z * parameters.tip_force_W_N;
  for (UnitDeviation& d : turned_parameters.unit_deviations) {
    const Eigen::Vector2d rest = Eigen::Rotation2Dd(angle) * Eigen::Vector2d(d.rest_u_rad, d.rest_v_rad);
    d.rest_u_rad = rest[0];
    d.rest_v_rad = rest[1];
  }
  for (auto& section : turned_parameters.sections) {
    for (auto& route : section.tendons) route.angle_rad += angle;
  }
  const Body turned(turned_parameters);
  MatrixXd turn = MatrixXd::Identity(n, n);
  for (int i = 0; i < body.units(); ++i) {
    const int at = body.coordinate(i);
    turn.block<2, 2>(at, at) = Eigen::Rotation2Dd(angle).toRotationMatrix();
    const int shear = at + (body.twists(i) ? 3 : 2) + (body.stretches(i) ? 1 : 0);
    if (body.shears(i)) turn.block<2, 2>(shear, shear) = turn.block<2, 2>(at, at);
  }
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -10, 10), tension = random.Vector(m, 0, 8);
    VectorXd force(n), ddq(n);
    turned.TendonForce(turn * q, tension, force);
    turned.ForwardDynamics(turn * q, turn * dq, force, ddq, workspace);
    const VectorXd expected = Forward(q, dq, TendonForce(q, tension));
    EXPECT_LT((turn.transpose() * ddq - expected).norm(), 1e-10 * expected.norm());
  }
}

TEST_P(StrainedBody, EnergyIsConservedInMotion) {
  BodyParameters drawn = parameters;
  for (SectionParameters& s : drawn.sections)
    s.bending_damping_Nms = s.torsional_damping_Nms = s.axial_damping_Nspm = s.shear_damping_Nspm = 0;
  const Body free(drawn);
  const VectorXd start = Shape(0, 0.3), rest = VectorXd::Zero(n);
  TensionProfile profile;
  profile.time_s = VectorXd::LinSpaced(2, 0, 0.01);
  profile.tension_N = MatrixXd::Zero(m, 2);
  const Energy first = free.EnergyOf(start, rest, workspace);
  double kinetic = 0;
  Simulate(free, profile, start, rest, 1e-3, 1e-10, [&](double, ConstVectorRef q, ConstVectorRef dq) {
    const Energy now = free.EnergyOf(q, dq, workspace);
    kinetic = std::max(kinetic, now.kinetic);
    EXPECT_NEAR(now.total(), first.total(), 1e-6 * first.elastic);
  });
  EXPECT_GT(kinetic, 0.05 * first.elastic);
}

INSTANTIATE_TEST_SUITE_P(RandomRobots, StrainedBody, testing::Range(1u, 7u));

BodyParameters Stiff(BodyParameters body, double torsional_Nm2, double axial_N) {
  for (SectionParameters& s : body.sections) {
    s.torsion = s.extension = true;
    s.torsional_stiffness_Nm2 = torsional_Nm2;
    s.axial_stiffness_N = axial_N;
  }
  return body;
}

// Coordinates u, v of a body with all four strains.
VectorXd Bends(const VectorXd& q) {
  VectorXd bends(q.size() / 2);
  for (Eigen::Index i = 0; i < q.size() / 4; ++i) bends.segment<2>(2 * i) = q.segment<2>(4 * i);
  return bends;
}

TEST(StrainedLimits, InfiniteTorsionalAndAxialStiffnessIsTheBodyThatOnlyBends) {
  Random random(4);
  for (const BodyParameters& parameters : {test::PaperBody(), test::TwoSections(), test::AsBuilt()}) {
    const Body bending(parameters), stiff(Stiff(parameters, 1e8, 1e14));
    const VectorXd tension = random.Vector(bending.tendons(), 0, 3);
    const TipWrench tip{random.Vector(3, -0.05, 0.05), random.Vector(3, -0.002, 0.002)};
    const Equilibrium expected = SolveStatics(bending, tension, tip),
                      found = SolveStatics(stiff, tension, tip);
    ASSERT_EQ(expected.result, StaticsResult::kConverged);
    ASSERT_EQ(found.result, StaticsResult::kConverged);
    EXPECT_LT((Bends(found.q) - expected.q).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((stiff.TipPose(found.q).p_WA - bending.TipPose(expected.q).p_WA).norm(), 1e-9);
    // The eigenvalues' range leaves no digits of the slow modes at such stiffness.
    const Body firm(Stiff(parameters, 100, 1e7));
    const VectorXd rest = VectorXd::Zero(bending.tendons());
    const Equilibrium bent = SolveStatics(bending, rest, {}), twisted = SolveStatics(firm, rest, {});
    const VectorXd slow = NaturalFrequencies(bending, bent.q, rest, Vector3d::Zero());
    const VectorXd all = NaturalFrequencies(firm, twisted.q, rest, Vector3d::Zero());
    for (Eigen::Index i = 0; i < slow.size(); ++i) EXPECT_NEAR(all[i], slow[i], 1e-4 * slow[i]);
  }
}

// Only tendons and the rotary inertia at the units' ends know where the disks are.
TEST(StrainedLimits, FewerDisksChangeNothingOfShapeWeightAndElasticity) {
  BodyParameters halves = test::PaperBody(4, 0.0225);
  halves.gravity_W_mps2 = {1, 2, -8};
  const Body each(halves);
  BodyParameters shared = halves;
  shared.sections[0].units_per_disk = 2;
  shared.sections[0].disk_mass_kg = 0;
  const Body two(shared);
  ASSERT_EQ(two.dof(), 8);
  ASSERT_EQ(two.disks(), 2);
  Random random(9);
  Body::Workspace workspace(two), plain(each);
  for (int k = 0; k < 5; ++k) {
    const VectorXd q = random.Vector(8, -1, 1);
    EXPECT_LT((two.TipPose(q).p_WA - each.TipPose(q).p_WA).norm(), 1e-16);
    EXPECT_LT((two.TipPose(q).R_WA - each.TipPose(q).R_WA).norm(), 1e-14);
    VectorXd a(8), b(8);
    two.StaticForce(q, {}, a);
    each.StaticForce(q, {}, b);
    EXPECT_LT((a - b).norm(), 1e-16);
    EXPECT_NEAR(two.EnergyOf(q, VectorXd::Zero(8), workspace).total(),
                each.EnergyOf(q, VectorXd::Zero(8), plain).total(), 1e-16);
  }
}

TEST(StrainedLimits, AStraightRodTwistsAndStretchesAsTheTextbookSays) {
  BodyParameters parameters = test::PaperBody(6, 0.015);
  SectionParameters& s = parameters.sections[0];
  s.torsion = s.extension = true;
  s.poissons_ratio = 0.3;
  s.units_per_disk = 3;
  parameters.gravity_W_mps2.setZero();
  const Body body(parameters);
  const double r2 = s.core_radius_m * s.core_radius_m, area = std::numbers::pi * r2;
  const double shear_modulus = s.youngs_modulus_Pa / 2.6, polar = std::numbers::pi * r2 * r2 / 2;
  const TipWrench tip{Vector3d(0, 0, 0.4), Vector3d(0, 0, 0.003)};
  const Equilibrium found = SolveStatics(body, Vector3d::Zero(), tip);
  ASSERT_EQ(found.result, StaticsResult::kConverged);
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(found.q[4 * i], 0, 1e-15);
    EXPECT_NEAR(found.q[4 * i + 1], 0, 1e-15);
    EXPECT_NEAR(found.q[4 * i + 2], 0.003 * s.unit_length_m / (shear_modulus * polar), 1e-14);
    EXPECT_NEAR(found.q[4 * i + 3], 0.4 / (s.youngs_modulus_Pa * area), 1e-16);
  }
}

TEST(StrainedLimits, StraightIsNoSpecialCase) {
  const Body body(test::RandomStrained(4));
  const int n = body.dof(), m = body.tendons();
  Random random(2);
  const VectorXd direction = random.Vector(n, -1, 1);
  Body::Workspace workspace(body);
  VectorXd at_0(n), near(n), tension = VectorXd::Constant(m, 2);
  body.TendonForce(VectorXd::Zero(n), tension, at_0);
  MatrixXd tangent(n, n);
  const double h = 1e-6;
  body.TendonForce(h * direction, tension, near);
  body.TangentStiffness(VectorXd::Zero(n), tension, {}, tangent);
  MatrixXd no_tension(n, n);
  body.TangentStiffness(VectorXd::Zero(n), VectorXd::Zero(m), {}, no_tension);
  EXPECT_TRUE(at_0.allFinite() && tangent.allFinite());
  EXPECT_LT((near - at_0 + h * (tangent - no_tension) * direction).norm(), 1e-12);
}

// ---- layouts of tendons ----

TEST(TendonLayout, HolesThatAllTurnAreADiskColumnThatTurns) {
  BodyParameters by_route = test::PaperBody(), by_body = by_route;
  by_body.twist_rad_per_m = 7;
  for (TendonRoute& t : by_route.sections[0].tendons) t.turn_rad_per_m = 7;
  const Body a(by_route), b(by_body);
  EXPECT_TRUE(a.bends_only());
  Random random(3);
  for (int k = 0; k < 4; ++k) {
    const VectorXd q = random.Vector(a.dof(), -0.8, 0.8), tension = random.Vector(3, 0, 8);
    VectorXd force_a(a.dof()), force_b(a.dof());
    a.TendonForce(q, tension, force_a);
    b.TendonForce(q, tension, force_b);
    EXPECT_LT((force_a - force_b).norm(), 1e-14);
    // One is computed as a body that only bends, the other as a chain that may strain in every way.
    Body::Workspace of_a(a), of_b(b);
    const VectorXd dq = random.Vector(a.dof(), -10, 10);
    VectorXd ddq_a(a.dof()), ddq_b(a.dof());
    a.ForwardDynamics(q, dq, force_a, ddq_a, of_a);
    b.ForwardDynamics(q, dq, force_b, ddq_b, of_b);
    EXPECT_LT((ddq_a - ddq_b).norm(), 1e-10 * ddq_b.norm());
    MatrixXd mass_a(a.dof(), a.dof()), mass_b(a.dof(), a.dof());
    a.MassMatrix(q, mass_a, of_a);
    b.MassMatrix(q, mass_b, of_b);
    EXPECT_LT((mass_a - mass_b).norm(), 1e-13 * mass_b.norm());
  }
}

TEST(TendonLayout, ATaperedAndHelicalTendonIsAsLongAsStraightLinesBetweenItsHoles) {
  BodyParameters parameters = test::PaperBody();
  TendonRoute& t = parameters.sections[0].tendons[1];
  t = {.angle_rad = 0.4, .radius_m = 0.005, .turn_rad_per_m = 20, .end_radius_m = 0.002};
  const Body body(parameters);
  double wanted_m = 0;
  const double l = parameters.sections[0].unit_length_m;
  const auto hole = [&](int disk) {
    const double radius = 0.005 - 0.003 * disk / 4, angle = 0.4 + 20 * l * disk;
    return Vector3d(radius * std::cos(angle), radius * std::sin(angle), l * disk);
  };
  for (int disk = 0; disk < 4; ++disk) wanted_m += (hole(disk + 1) - hole(disk)).norm();
  VectorXd length(3);
  body.TendonLengths(VectorXd::Zero(body.dof()), length);
  EXPECT_NEAR(length[1], wanted_m, 1e-15);
  const Eigen::Matrix3Xd at = TendonHoles(body, VectorXd::Zero(body.dof()), 1);
  for (int disk = 0; disk <= 4; ++disk) EXPECT_LT((at.col(disk) - hole(disk)).norm(), 1e-16);
}

TEST(TendonLayout, ATendonBendsTheRobotUpToItsLastDiskAlone) {
  BodyParameters parameters = test::PaperBody();
  parameters.gravity_W_mps2.setZero();
  parameters.sections[0].tendons[0].ends_at_disk = 2;
  const Body body(parameters);
  EXPECT_EQ(body.tendon_end_disk(0), 2);
  const Equilibrium found = SolveStatics(body, Vector3d(4, 0, 0), {});
  ASSERT_EQ(found.result, StaticsResult::kConverged);
  EXPECT_GT(found.q[0], 0.1);
  EXPECT_NEAR(found.q[2], found.q[0], 1e-10);
  EXPECT_LT(found.q.tail(4).norm(), 1e-12);
  EXPECT_EQ(TendonHoles(body, found.q, 0).cols(), 3);
  VectorXd length(3);
  body.TendonLengths(VectorXd::Zero(body.dof()), length);
  EXPECT_NEAR(length[0], 2 * parameters.sections[0].unit_length_m, 1e-15);
}

// Two tendons that wind in opposite ways pull without a moment about the axis; one alone twists the backbone.
TEST(TendonLayout, AHelixTwistsABackboneAndItsMirrorImageUndoesIt) {
  BodyParameters parameters = test::PaperBody(6, 0.015);
  SectionParameters& s = parameters.sections[0];
  s.torsion = s.extension = s.shear = true;
  s.poissons_ratio = 0.3;
  parameters.gravity_W_mps2.setZero();
  s.tendons = {{.angle_rad = 0, .radius_m = 0.004, .turn_rad_per_m = 15},
               {.angle_rad = 0, .radius_m = 0.004, .turn_rad_per_m = -15}};
  const Body body(parameters);
  const auto twist = [&](double first_N, double second_N) {
    const Equilibrium found = SolveStatics(body, Eigen::Vector2d(first_N, second_N), {});
    EXPECT_EQ(found.result, StaticsResult::kConverged);
    double sum = 0;
    for (int i = 0; i < body.units(); ++i) sum += body.StrainsOf(i, found.q)[2];
    return sum;
  };
  EXPECT_GT(std::abs(twist(2, 0)), 1e-3);
  EXPECT_NEAR(twist(2, 0), -twist(0, 2), 1e-9);
  EXPECT_NEAR(twist(2, 2), 0, 1e-9);
}

TEST(StrainedLimits, ConstructionRefusesWhatMakesNoSense) {
  const auto refuses = [](auto change) {
    BodyParameters parameters = Stiff(test::PaperBody(), 1e-3, 1e4);
    change(parameters.sections[0]);
    EXPECT_THROW(Body{parameters}, std::invalid_argument);
  };
  refuses([](SectionParameters& s) { s.units_per_disk = 0; });
  refuses([](SectionParameters& s) { s.units_per_disk = 3; });
  refuses([](SectionParameters& s) { s.disk_mass_kg = -1; });
  refuses([](SectionParameters& s) { s.torsional_stiffness_Nm2.reset(); });
  refuses([](SectionParameters& s) { s.torsional_stiffness_Nm2 = 0; });
  refuses([](SectionParameters& s) { s.axial_stiffness_N = std::numeric_limits<double>::quiet_NaN(); });
  refuses([](SectionParameters& s) { s.poissons_ratio = 0.6; });
  refuses([](SectionParameters& s) { s.rest_extension = -1; });
  refuses([](SectionParameters& s) { s.torsional_damping_Nms = -1; });
  refuses([](SectionParameters& s) {
    s.shear = true;
    s.poissons_ratio.reset();
  });
  refuses([](SectionParameters& s) {
    s.shear = true;
    s.shear_stiffness_N = 0;
  });
  refuses([](SectionParameters& s) { s.tendons[0].end_radius_m = 0; });
  refuses([](SectionParameters& s) { s.tendons[0].ends_at_disk = 5; });
  refuses(
      [](SectionParameters& s) { s.tendons[0].turn_rad_per_m = std::numeric_limits<double>::infinity(); });
  refuses([](SectionParameters& s) {
    s.torsion = false;
    s.rest_torsion_rad_per_m = 1;
  });
}

}  // namespace
}  // namespace tendril::model
