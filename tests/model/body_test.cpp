// What must hold of the body whatever its numbers: consistency of forces, energies and shapes, and symmetry.
#include "tendril/model/body.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <functional>
#include <limits>
#include <stdexcept>

#include "bodies.h"

namespace tendril::model {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using test::Random;

// Sixth-order central difference of a vector function along `direction`.
VectorXd Slope(const std::function<VectorXd(double)>& f, double h) {
  return (45 * (f(h) - f(-h)) - 9 * (f(2 * h) - f(-2 * h)) + (f(3 * h) - f(-3 * h))) / (60 * h);
}

MatrixXd Jacobian(const std::function<VectorXd(const VectorXd&)>& f, const VectorXd& q, double h) {
  MatrixXd jacobian(f(q).size(), q.size());
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    jacobian.col(i) = Slope([&](double s) { return f(q + s * VectorXd::Unit(q.size(), i)); }, h);
  }
  return jacobian;
}

class BodyProperties : public testing::TestWithParam<BodyParameters> {
 protected:
  BodyProperties() : body(GetParam()), workspace(body), n(body.dof()), m(body.tendons()) {}

  // Shapes that bend each unit by up to about 2 rad, some of them barely.
  VectorXd Shape(int k) { return random.Vector(n, -1.4, 1.4) * (k % 4 == 3 ? 1e-5 : 1.0); }

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
  MatrixXd Mass(const VectorXd& q) {
    MatrixXd mass(n, n);
    body.MassMatrix(q, mass, workspace);
    return mass;
  }

  Body body;
  Body::Workspace workspace;
  int n, m;
  Random random{7};
};

TEST_P(BodyProperties, MassMatrixIsSymmetricPositiveDefinite) {
  for (int k = 0; k < 30; ++k) {
    const MatrixXd mass = Mass(Shape(k));
    EXPECT_EQ((mass - mass.transpose()).cwiseAbs().maxCoeff(), 0);
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(mass).eigenvalues()[0], 0);
  }
}

TEST_P(BodyProperties, MassMatrixColumnsAreWhatUnitAccelerationsNeed) {
  const VectorXd rest = VectorXd::Zero(n);
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k);
    const MatrixXd mass = Mass(q);
    const VectorXd still = Inverse(q, rest, rest);
    for (int i = 0; i < n; ++i) {
      // Accelerations large enough that the rounding of the elastic forces does not matter.
      const VectorXd column = (Inverse(q, rest, 1e6 * VectorXd::Unit(n, i)) - still) / 1e6;
      EXPECT_LT((column - mass.col(i)).norm(), 1e-13 * mass.col(i).norm());
    }
  }
}

TEST_P(BodyProperties, ForwardUndoesInverse) {
  for (int k = 0; k < 50; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -20, 20), ddq = random.Vector(n, -1e4, 1e4);
    EXPECT_LT((Forward(q, dq, Inverse(q, dq, ddq)) - ddq).norm(), 1e-10 * ddq.norm());
  }
}

TEST_P(BodyProperties, KineticEnergyIsTheMassMatrixsQuadraticForm) {
  for (int k = 0; k < 20; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -20, 20);
    const double kinetic = body.EnergyOf(q, dq, workspace).kinetic;
    EXPECT_NEAR(0.5 * dq.dot(Mass(q) * dq), kinetic, 1e-12 * kinetic);
  }
}

TEST_P(BodyProperties, PowerOfTheForcesIsTheChangeOfEnergyPlusWhatDampingTakes) {
  for (int k = 0; k < 20; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -5, 5), force = random.Vector(n, -0.02, 0.02);
    const VectorXd ddq = Forward(q, dq, force);
    // Energy along the quadratic through the state has the true motion's first derivative.
    const double rate = Slope(
        [&](double t) {
          const VectorXd at = q + t * dq + 0.5 * t * t * ddq, speed = dq + t * ddq;
          return VectorXd::Constant(1, body.EnergyOf(at, speed, workspace).total());
        },
        2e-6)[0];
    double lost = 0;
    for (int s = 0; s < body.sections(); ++s) {
      for (int i = 2 * body.first_unit(s); i < 2 * body.end_unit(s); ++i) {
        lost += body.parameters().sections[static_cast<std::size_t>(s)].bending_damping_Nms * dq[i] * dq[i];
      }
    }
    const double power = force.dot(dq);
    EXPECT_NEAR(rate + lost, power, 1e-7 * force.cwiseAbs().dot(dq.cwiseAbs()));
  }
}

TEST_P(BodyProperties, TendonForceIsMinusTheGradientOfTensionTimesLength) {
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k), tension = random.Vector(m, 0, 8);
    MatrixXd jacobian(m, n);
    body.TendonLengthJacobian(q, jacobian);
    const MatrixXd differences = Jacobian(
        [&](const VectorXd& at) {
          VectorXd length(m);
          body.TendonLengths(at, length);
          return length;
        },
        q, 1e-2);
    EXPECT_LT((jacobian - differences).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_LT((TendonForce(q, tension) + jacobian.transpose() * tension).norm(), 1e-15);
  }
}

TEST_P(BodyProperties, ShorteningIsExactDownToTheLastBendThatMoves) {
  VectorXd straight(m), length(m), shortening(m);
  body.TendonLengths(VectorXd::Zero(n), straight);
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k);
    body.TendonLengths(q, length);
    body.TendonShortening(q, shortening);
    EXPECT_LT((straight - length - shortening).cwiseAbs().maxCoeff(), 1e-16);
  }
  // 1e-12 rad to tendon 1's side: r times that and a chord's share, which a difference of lengths could not
  // show.
  VectorXd q = VectorXd::Zero(n);
  const SectionParameters& first = body.parameters().sections[0];
  const TendonRoute route = first.tendons[0];
  q[0] = 1e-12 * std::cos(route.angle_rad);
  q[1] = 1e-12 * std::sin(route.angle_rad);
  body.TendonShortening(q, shortening);
  if (body.parameters().twist_rad_per_m == 0) {
    const double expected = 1e-12 * route.radius_m + 1e-24 / 24 * first.unit_length_m;
    EXPECT_NEAR(shortening[0], expected, 1e-15 * expected);
  } else {
    MatrixXd jacobian(m, n);
    body.TendonLengthJacobian(VectorXd::Zero(n), jacobian);
    EXPECT_NEAR(shortening[0], -jacobian.row(0).dot(q), 1e-11 * shortening[0]);
  }
}

TEST_P(BodyProperties, ShorteningWithItsDerivativesIsTheSameAsWithout) {
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k);
    VectorXd shortening(m), with_them(m);
    MatrixXd jacobian(m, n);
    body.TendonShortening(q, shortening);
    body.TendonShortening(q, with_them, jacobian);
    EXPECT_LT((with_them - shortening).cwiseAbs().maxCoeff(), 1e-17);
  }
}

// From the holes' places in space alone.
TEST_P(BodyProperties, TendonsRunStraightFromHoleToHole) {
  const BodyParameters& parameters = body.parameters();
  std::vector<Pose> poses(static_cast<std::size_t>(body.units()) + 1);
  MatrixXd spans(m, body.units()), turns(m, body.units());
  VectorXd length(m), shortening(m);
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k);
    body.Poses(q, std::span(poses).subspan(1));
    body.TendonLengths(q, length);
    body.TendonShortening(q, shortening);
    body.SpanShortening(q, spans);
    body.TendonTurns(q, turns);
    EXPECT_LT((spans.rowwise().sum() - shortening).norm(), 1e-16);
    int j = 0;
    for (int s = 0; s < body.sections(); ++s) {
      for (const TendonRoute& route : parameters.sections[static_cast<std::size_t>(s)].tendons) {
        double arc_m = 0, total_m = 0;
        Vector3d before(0, 0, 0), last;
        for (int i = 0; i <= body.end_unit(s); ++i) {
          const double angle = route.angle_rad + parameters.twist_rad_per_m * arc_m;
          const Pose& disk = poses[static_cast<std::size_t>(i)];
          const Vector3d hole =
              disk.p_WA + route.radius_m * (disk.R_WA * Vector3d(std::cos(angle), std::sin(angle), 0));
          if (i > 0) {
            const Vector3d span = hole - last;
            total_m += span.norm();
            if (i > 1) {
              const double turn = 2 * std::asin(0.5 * (span.normalized() - before.normalized()).norm());
              EXPECT_NEAR(turns(j, i - 2), turn, 1e-13);
            }
            before = span;
          }
          last = hole;
          int section = 0;
          while (section + 1 < body.sections() && i >= body.end_unit(section)) ++section;
          arc_m += parameters.sections[static_cast<std::size_t>(section)].unit_length_m;
        }
        EXPECT_NEAR(length[j], total_m, 1e-15);
        EXPECT_EQ(turns.row(j).tail(body.units() - body.end_unit(s) + 1).norm(), 0);
        EXPECT_EQ(spans.row(j).tail(body.units() - body.end_unit(s)).norm(), 0);
        ++j;
      }
    }
  }
}

TEST_P(BodyProperties, ForcesOnDisksDoTheWorkOfTheirDisksMotion) {
  std::vector<Pose> poses(static_cast<std::size_t>(body.units()));
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k);
    Eigen::Matrix3Xd forces(3, body.units());
    for (int i = 0; i < body.units(); ++i) forces.col(i) = random.Vector(3, -1, 1);
    VectorXd force(n);
    body.DiskForce(q, forces, force);
    const MatrixXd work = Jacobian(
        [&](const VectorXd& at) {
          body.Poses(at, poses);
          double sum = 0;
          for (int i = 0; i < body.units(); ++i) {
            sum += forces.col(i).dot(poses[static_cast<std::size_t>(i)].p_WA);
          }
          return VectorXd::Constant(1, sum);
        },
        q, 1e-2);
    EXPECT_LT((work.row(0).transpose() - force).norm(), 1e-12);
  }
}

TEST_P(BodyProperties, TangentStiffnessIsTheDerivativeOfTheStaticForces) {
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k), tension = random.Vector(m, 0, 8);
    const Vector3d tip_force = random.Vector(3, -0.3, 0.3);
    MatrixXd stiffness(n, n);
    body.TangentStiffness(q, tension, tip_force, stiffness);
    const MatrixXd differences = Jacobian(
        [&](const VectorXd& at) {
          VectorXd held(n);
          body.StaticForce(at, tip_force, held);
          return VectorXd(held - TendonForce(at, tension));
        },
        q, 1e-2);
    EXPECT_LT((stiffness - differences).cwiseAbs().maxCoeff(), 1e-12 * stiffness.cwiseAbs().maxCoeff());
    EXPECT_EQ((stiffness - stiffness.transpose()).cwiseAbs().maxCoeff(), 0);
  }
}

TEST_P(BodyProperties, StaticForceIsTheInverseDynamicsAtRestLessTheTipForcesShare) {
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k), rest = VectorXd::Zero(n);
    const Vector3d tip_force = random.Vector(3, -0.3, 0.3);
    MatrixXd jacobian(6, n);
    body.TipJacobian(q, jacobian);
    VectorXd held(n);
    body.StaticForce(q, tip_force, held);
    EXPECT_LT((held - Inverse(q, rest, rest) + jacobian.topRows(3).transpose() * tip_force).norm(), 1e-15);
  }
}

TEST_P(BodyProperties, TipJacobianIsTheDerivativeOfTheTipPose) {
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k);
    MatrixXd jacobian(6, n);
    body.TipJacobian(q, jacobian);
    const Pose here = body.TipPose(q);
    const MatrixXd differences = Jacobian(
        [&](const VectorXd& at) {
          const Pose pose = body.TipPose(at);
          VectorXd flat(12);
          flat << pose.p_WA, pose.R_WA.reshaped();
          return flat;
        },
        q, 1e-2);
    EXPECT_LT((jacobian.topRows(3) - differences.topRows(3)).cwiseAbs().maxCoeff(), 1e-13);
    for (int i = 0; i < n; ++i) {
      const Matrix3d rate = Eigen::Map<const Matrix3d>(VectorXd(differences.col(i).tail(9)).data());
      const Matrix3d spin = rate * here.R_WA.transpose();
      EXPECT_LT((Vector3d(spin(2, 1), spin(0, 2), spin(1, 0)) - jacobian.col(i).tail<3>()).norm(), 1e-11);
    }
  }
}

TEST_P(BodyProperties, PosesEndAtTheTipAndAreRotations) {
  std::vector<Pose> poses(static_cast<std::size_t>(body.units()));
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k);
    body.Poses(q, poses);
    EXPECT_EQ(poses.back().p_WA, body.TipPose(q).p_WA);
    EXPECT_EQ(poses.back().R_WA, body.TipPose(q).R_WA);
    for (const Pose& pose : poses) {
      EXPECT_LT((pose.R_WA.transpose() * pose.R_WA - Matrix3d::Identity()).norm(), 1e-14);
      EXPECT_GT(pose.R_WA.determinant(), 0);
    }
  }
}

// Robot, gravity and motion turned about z by `angle`: everything turns with them.
TEST_P(BodyProperties, NothingChangesWhenEverythingTurnsAboutZ) {
  const double angle = 0.7;
  BodyParameters parameters = GetParam();
  const Eigen::AngleAxisd about_z(angle, Vector3d::UnitZ());
  parameters.gravity_W_mps2 = about_z * parameters.gravity_W_mps2;
  parameters.tip_force_W_N = about_z * parameters.tip_force_W_N;
  for (UnitDeviation& d : parameters.unit_deviations) {
    const Eigen::Vector2d rest = Eigen::Rotation2Dd(angle) * Eigen::Vector2d(d.rest_u_rad, d.rest_v_rad);
    d.rest_u_rad = rest[0];
    d.rest_v_rad = rest[1];
  }
  for (auto& section : parameters.sections) {
    for (auto& route : section.tendons) route.angle_rad += angle;
  }
  const Body turned(parameters);
  MatrixXd turn = MatrixXd::Zero(n, n);
  for (int i = 0; i < n; i += 2) turn.block<2, 2>(i, i) = Eigen::Rotation2Dd(angle).toRotationMatrix();
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -10, 10), tension = random.Vector(m, 0, 8);
    VectorXd force(n), ddq(n);
    turned.TendonForce(turn * q, tension, force);
    turned.ForwardDynamics(turn * q, turn * dq, force, ddq, workspace);
    const VectorXd expected = Forward(q, dq, TendonForce(q, tension));
    EXPECT_LT((turn.transpose() * ddq - expected).norm(), 1e-11 * expected.norm());
  }
}

// The mirror image in the plane y = 0 moves as the mirror image.
TEST_P(BodyProperties, TheMirrorImageMovesAsTheMirrorImage) {
  BodyParameters parameters = GetParam();
  parameters.gravity_W_mps2.y() *= -1;
  parameters.tip_force_W_N.y() *= -1;
  parameters.twist_rad_per_m *= -1;
  for (UnitDeviation& d : parameters.unit_deviations) d.rest_v_rad *= -1;
  for (auto& section : parameters.sections) {
    for (auto& route : section.tendons) route.angle_rad *= -1;
  }
  const Body image(parameters);
  VectorXd mirror = VectorXd::Ones(n);
  for (int i = 1; i < n; i += 2) mirror[i] = -1;
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = Shape(k), dq = random.Vector(n, -10, 10), tension = random.Vector(m, 0, 8);
    VectorXd force(n), ddq(n);
    image.TendonForce(mirror.cwiseProduct(q), tension, force);
    image.ForwardDynamics(mirror.cwiseProduct(q), mirror.cwiseProduct(dq), force, ddq, workspace);
    const VectorXd expected = Forward(q, dq, TendonForce(q, tension));
    EXPECT_LT((mirror.cwiseProduct(ddq) - expected).norm(), 1e-11 * expected.norm());
  }
}

TEST_P(BodyProperties, SectionsShareTheirBendEquallyAndForcesDoTheSameWork) {
  const int sections = 2 * body.sections();
  const VectorXd us_vs = random.Vector(sections, -2, 2), force = random.Vector(n, -1, 1);
  VectorXd q(n), sum(sections), projected(sections);
  body.SpreadBending(us_vs, q);
  body.SumBending(q, sum);
  EXPECT_LT((sum - us_vs).norm(), 1e-15);
  body.ProjectForce(force, projected);
  EXPECT_NEAR(projected.dot(us_vs), force.dot(q), 1e-15);
  for (int s = 0; s < body.sections(); ++s) {
    for (int i = body.first_unit(s); i < body.end_unit(s); ++i) {
      EXPECT_EQ(q.segment(2 * i, 2), q.segment(2 * body.first_unit(s), 2));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Robots, BodyProperties,
                         testing::Values(test::PaperBody(), test::TwoSections(), test::PaperBody(1, 0.09),
                                         test::PaperBody(12, 0.0075), test::AsBuilt()),
                         [](const auto& robot) {
                           return std::to_string(robot.param.sections.size()) + "Sections" +
                                  std::to_string(robot.param.units()) + "Units" +
                                  (robot.param.unit_deviations.empty() ? "" : "AsBuilt");
                         });

TEST(Body, LoadsAndRestShapeEnterTheEnergyAsTheirDefinitionsSay) {
  const BodyParameters built = test::AsBuilt();
  BodyParameters drawn = built;
  drawn.tip_payload_kg = 0;
  drawn.tip_force_W_N.setZero();
  drawn.unit_deviations.clear();
  const Body body(built), plain(drawn);
  Body::Workspace workspace(body);
  Random random(3);
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = random.Vector(10, -1, 1), dq = random.Vector(10, -5, 5);
    const Energy with = body.EnergyOf(q, dq, workspace), without = plain.EnergyOf(q, dq, workspace);
    MatrixXd jacobian(6, 10);
    body.TipJacobian(q, jacobian);
    const Vector3d tip = body.TipPose(q).p_WA, velocity = jacobian.topRows(3) * dq;
    EXPECT_NEAR(with.kinetic - without.kinetic, 0.5 * built.tip_payload_kg * velocity.squaredNorm(), 1e-15);
    EXPECT_NEAR(with.gravity - without.gravity,
                -(built.tip_payload_kg * built.gravity_W_mps2 + built.tip_force_W_N).dot(tip), 1e-15);
    double elastic = 0;
    for (int i = 0; i < 5; ++i) {
      double stiffness = drawn.sections[i < 3 ? 0 : 1].UnitStiffness();
      Eigen::Vector2d rest(0, 0);
      for (const UnitDeviation& d : built.unit_deviations) {
        if (d.unit != i + 1) continue;
        stiffness *= d.stiffness_scale;
        rest = {d.rest_u_rad, d.rest_v_rad};
      }
      elastic += 0.5 * stiffness * (q.segment<2>(2 * i) - rest).squaredNorm();
    }
    EXPECT_NEAR(with.elastic, elastic, 1e-15);
  }
}

TEST(Body, DeviationsThatAreNoneChangeNoBit) {
  BodyParameters parameters = test::TwoSections();
  const Body plain(parameters);
  for (int unit = 5; unit >= 1; --unit) parameters.DeviationOf(unit);
  ASSERT_EQ(parameters.unit_deviations.size(), 5u);
  EXPECT_EQ(&parameters.DeviationOf(3), &parameters.unit_deviations[2]);
  const Body body(parameters);
  Body::Workspace workspace(body);
  Random random(11);
  for (int k = 0; k < 10; ++k) {
    const VectorXd q = random.Vector(10, -1, 1), dq = random.Vector(10, -5, 5),
                   force = random.Vector(10, -1, 1);
    VectorXd a(10), b(10);
    body.ForwardDynamics(q, dq, force, a, workspace);
    plain.ForwardDynamics(q, dq, force, b, workspace);
    EXPECT_EQ(a, b);
  }
}

TEST(Body, OneUnitAtRestStraightIsATextbookRotor) {
  // A single straight unit: mass m at the end of a rocker whose end moves l/2 per rad and turns 1 per rad.
  const BodyParameters p = test::PaperBody(1);
  const SectionParameters& s = p.sections[0];
  const Body body(p);
  Body::Workspace workspace(body);
  MatrixXd mass(2, 2);
  body.MassMatrix(VectorXd::Zero(2), mass, workspace);
  const double expected = s.unit_mass_kg * s.unit_length_m * s.unit_length_m / 4 + s.disk_inertia_xx_kgm2;
  EXPECT_NEAR(mass(0, 0), expected, 1e-15 * expected);
  EXPECT_NEAR(mass(1, 1), expected, 1e-15 * expected);
  EXPECT_NEAR(mass(0, 1), 0, 1e-20);
}

TEST(Body, ConstructionRefusesWhatMakesNoSense) {
  const auto refuses = [](auto change) {
    BodyParameters parameters = test::PaperBody();
    change(parameters);
    EXPECT_THROW(Body{parameters}, std::invalid_argument);
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  refuses([](BodyParameters& p) { p.sections.clear(); });
  refuses([](BodyParameters& p) { p.sections.resize(5, p.sections[0]); });
  refuses([](BodyParameters& p) { p.sections[0].units = 0; });
  refuses([](BodyParameters& p) { p.sections[0].units = 65; });
  refuses([](BodyParameters& p) { p.sections[0].unit_length_m = 0; });
  refuses([](BodyParameters& p) { p.sections[0].unit_mass_kg = -1; });
  refuses([](BodyParameters& p) { p.sections[0].disk_inertia_zz_kgm2 = kNan; });
  refuses([](BodyParameters& p) { p.sections[0].bending_damping_Nms = -1e-9; });
  refuses([](BodyParameters& p) { p.sections[0].tendons.clear(); });
  refuses([](BodyParameters& p) { p.sections[0].tendons[1].radius_m = 0; });
  refuses([](BodyParameters& p) { p.sections[0].tendons.resize(17, {0.1, 0.004}); });
  refuses([](BodyParameters& p) { p.gravity_W_mps2.x() = kNan; });
  refuses([](BodyParameters& p) { p.tip_payload_kg = -1e-3; });
  refuses([](BodyParameters& p) { p.tip_force_W_N.y() = kNan; });
  refuses([](BodyParameters& p) { p.twist_rad_per_m = kNan; });
  refuses([](BodyParameters& p) { p.DeviationOf(5).stiffness_scale = 0.9; });
  refuses([](BodyParameters& p) { p.DeviationOf(0); });
  refuses([](BodyParameters& p) { p.DeviationOf(2).stiffness_scale = 0; });
  refuses([](BodyParameters& p) { p.DeviationOf(2).rest_u_rad = kNan; });
}

}  // namespace
}  // namespace tendril::model
