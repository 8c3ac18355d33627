// The body against an independent formulation (weighted points, d'Alembert, numerical derivatives at 120
// digits) at random states: straight, almost straight, near theta = pi, and anything between, with random
// tensions.
#include <gtest/gtest.h>

#include <algorithm>

#include "bodies.h"
#include "golden.h"
#include "tendril/model/body.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::Golden;

double RelativeError(const VectorXd& a, const VectorXd& b) {
  return (a - b).lpNorm<Eigen::Infinity>() / b.lpNorm<Eigen::Infinity>();
}

void CheckAccelerations(const std::string& file, const BodyParameters& parameters, std::size_t least_rows) {
  const Body body(parameters);
  Body::Workspace workspace(body);
  const Golden golden(file);
  const int n = body.dof();
  ASSERT_GE(golden.size(), least_rows);
  double worst_forward = 0, worst_inverse = 0;
  for (std::size_t row = 0; row < golden.size(); ++row) {
    const VectorXd q = golden.At(row, "u1", n), dq = golden.At(row, "du1", n);
    const VectorXd tension = golden.At(row, "T1", body.tendons()), expected = golden.At(row, "ddu1", n);
    VectorXd force(n), ddq(n), needed(n);
    body.TendonForce(q, tension, force);
    body.ForwardDynamics(q, dq, force, ddq, workspace);
    const double forward = RelativeError(ddq, expected);
    EXPECT_LT(forward, 1e-10) << file << " row " << row + 2;
    body.InverseDynamics(q, dq, expected, needed, workspace);
    // The forces balance large parts against each other, so the inverse is judged by the largest of them.
    VectorXd inertia(n), rest(n);
    body.InverseDynamics(q, dq, VectorXd::Zero(n), rest, workspace);
    inertia = needed - rest;
    const double scale = std::max({force.lpNorm<Eigen::Infinity>(), inertia.lpNorm<Eigen::Infinity>()});
    const double inverse = (needed - force).lpNorm<Eigen::Infinity>() / scale;
    EXPECT_LT(inverse, 1e-12) << file << " row " << row + 2;
    worst_forward = std::max(worst_forward, forward);
    worst_inverse = std::max(worst_inverse, inverse);
  }
  testing::Test::RecordProperty("worst_relative_error_forward",
                                std::to_string(worst_forward * 1e12) + "e-12");
  testing::Test::RecordProperty("worst_relative_error_inverse",
                                std::to_string(worst_inverse * 1e12) + "e-12");
}

TEST(BodyGolden, AccelerationsOfThePaperRobotAtAThousandStates) {
  CheckAccelerations("accel_paper.csv", test::PaperBody(), 1000);
}

TEST(BodyGolden, AccelerationsOfTwoSections) {
  CheckAccelerations("accel_two_sections.csv", test::TwoSections(), 150);
}

void CheckShapes(const std::string& file, const BodyParameters& parameters) {
  const Body body(parameters);
  Body::Workspace workspace(body);
  const Golden golden(file);
  const int n = body.dof();
  ASSERT_GE(golden.size(), 20u);
  for (std::size_t row = 0; row < golden.size(); ++row) {
    SCOPED_TRACE(file + " row " + std::to_string(row + 2));
    const VectorXd q = golden.At(row, "u1", n), dq = golden.At(row, "du1", n);
    const Energy energy = body.EnergyOf(q, dq, workspace);
    const VectorXd expected = golden.At(row, "kinetic", 3);
    EXPECT_NEAR(energy.kinetic, expected[0], 1e-14 * expected[0]);
    EXPECT_NEAR(energy.elastic, expected[1], 1e-14 * expected[1]);
    EXPECT_NEAR(energy.gravity, expected[2], 1e-15 * 0.1);  // some 0.01 kg x 10 m/s^2 x 0.1 m

    const Pose tip = body.TipPose(q);
    EXPECT_LT((tip.p_WA - golden.At(row, "x", 3)).norm(), 1e-15 * parameters.length_m() * 3);
    const VectorXd r = golden.At(row, "R11", 9);
    EXPECT_LT((tip.R_WA - Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data())).norm(),
              5e-15);

    VectorXd length(body.tendons());
    body.TendonLengths(q, length);
    EXPECT_LT(RelativeError(length, golden.At(row, "L1", body.tendons())), 1e-15);

    MatrixXd mass(n, n);
    body.MassMatrix(q, mass, workspace);
    const VectorXd upper = golden.At(row, "H1_1", n * (n + 1) / 2);
    for (int i = 0, k = 0; i < n; ++i) {
      for (int j = i; j < n; ++j, ++k) {
        EXPECT_NEAR(mass(i, j), upper[k], 2e-14 * std::sqrt(mass(i, i) * mass(j, j))) << i << " " << j;
      }
    }
  }
}

TEST(BodyGolden, ShapesEnergiesAndMassOfThePaperRobot) { CheckShapes("shapes_paper.csv", test::PaperBody()); }

TEST(BodyGolden, ShapesEnergiesAndMassOfTwoSections) {
  CheckShapes("shapes_two_sections.csv", test::TwoSections());
}

}  // namespace
}  // namespace tendril::model
