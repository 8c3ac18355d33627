// Tension allocation against brute force over all active sets, and the properties a controller relies on:
// bounds, balance, continuity, symmetry. Knows nothing of bodies; the tendon geometry here is the textbook
// one.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>

#include "tendril/model/inverse.h"

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using std::numbers::pi;

constexpr double kHoleRadius_m = 0.004;

/// Force on (us, vs) of each section per tension: straight sections, tendons equally spaced, `per_section`
/// each; tendons of later sections pass through (and load) the earlier ones.
MatrixXd StraightJacobian(int sections, int per_section, double twist_rad = 0.4) {
  MatrixXd a = MatrixXd::Zero(2 * sections, sections * per_section);
  for (int k = 0; k < sections; ++k) {
    for (int j = 0; j < per_section; ++j) {
      const double angle = 2 * pi * j / per_section + twist_rad * k;
      for (int i = 0; i <= k; ++i) {
        a.col(k * per_section + j).segment<2>(2 * i) =
            kHoleRadius_m * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      }
    }
  }
  return a;
}

struct Reference {
  VectorXd tension_N;
  double residual_Nm;
};

/// Every way of putting each tendon at its lower bound, upper bound or in between; the best admissible one
/// wins.
Reference BruteForce(const MatrixXd& a, const VectorXd& force, double low, const VectorXd& high) {
  const int m = static_cast<int>(a.cols());
  const double scale = a.norm() * std::max(1.0, high.maxCoeff());
  Reference best{VectorXd(), 1e300};
  double best_norm = 1e300;
  std::vector<int> state(m, 0);
  for (;;) {
    std::vector<int> free;
    VectorXd x = VectorXd::Constant(m, low);
    for (int j = 0; j < m; ++j) {
      if (state[j] == 2) free.push_back(j);
      if (state[j] == 1) x[j] = high[j];
    }
    if (!free.empty()) {
      MatrixXd columns(a.rows(), free.size());
      VectorXd start(free.size());
      for (std::size_t i = 0; i < free.size(); ++i) columns.col(i) = a.col(free[i]);
      Eigen::JacobiSVD<MatrixXd, Eigen::ColPivHouseholderQRPreconditioner> svd(
          columns, Eigen::ComputeThinU | Eigen::ComputeThinV);
      svd.setThreshold(1e-9);
      const VectorXd solved = svd.solve(force - a * x);  // of least norm above the lower bound
      for (std::size_t i = 0; i < free.size(); ++i) x[free[i]] += solved[i];
    }
    if (x.minCoeff() >= low - 1e-10 && (x - high).maxCoeff() <= 1e-10) {
      const double residual = (a * x - force).norm();
      const double norm = (x.array() - low).matrix().norm();
      const bool nearer = residual < best.residual_Nm - 1e-12 * scale;
      const bool as_near = residual < best.residual_Nm + 1e-12 * scale;
      if (nearer || (as_near && norm < best_norm)) {
        best = {x, nearer ? residual : std::min(residual, best.residual_Nm)};
        best_norm = norm;
      }
    }
    int j = 0;
    while (j < m && ++state[j] == 3) state[j++] = 0;
    if (j == m) return best;
  }
}
Reference BruteForce(const MatrixXd& a, const VectorXd& force, double low, double high) {
  return BruteForce(a, force, low, VectorXd::Constant(a.cols(), high));
}

TEST(Allocation, AgreesWithBruteForceOverAllActiveSets) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  int feasible = 0, infeasible = 0;
  for (int tendons = 3; tendons <= 7; ++tendons) {
    for (int repeat = 0; repeat < (tendons < 6 ? 60 : 12); ++repeat) {
      const int forces = tendons >= 5 && repeat % 2 ? 4 : 2;
      MatrixXd a(forces, tendons);
      for (double& v : a.reshaped()) v = kHoleRadius_m * uniform(random);
      VectorXd force(forces);
      for (double& v : force) v = 0.03 * uniform(random);
      if (repeat % 3) {  // a force that some admissible tensions produce
        VectorXd t(tendons);
        for (double& v : t) v = std::clamp(4 + 6 * uniform(random), 0.3, 8.0);
        force = a * t;
      }
      const TensionAllocator allocator(tendons, forces);
      const auto result = allocator.Allocate(a, force, 0.3, 8);
      const Reference expected = BruteForce(a, force, 0.3, 8);
      const bool reachable = expected.residual_Nm < 1e-9 * force.norm();
      (reachable ? feasible : infeasible)++;
      EXPECT_EQ(result.status, reachable ? Status::kOk : Status::kLimitedTensionMax);
      EXPECT_NEAR(result.residual_Nm, expected.residual_Nm, 1e-14) << tendons << " tendons, case " << repeat;
      EXPECT_LT((result.tension_N - expected.tension_N).cwiseAbs().maxCoeff(), 1e-9)
          << tendons << " tendons, case " << repeat << "\n"
          << result.tension_N.transpose() << "\n"
          << expected.tension_N.transpose();
    }
  }
  EXPECT_GT(feasible, 60);
  EXPECT_GT(infeasible, 30);
}

TEST(Allocation, AGreatestTensionForEachTendonAgreesWithBruteForce) {
  std::mt19937 random(12);
  std::uniform_real_distribution<double> uniform(0, 1);
  int limited = 0;
  for (int repeat = 0; repeat < 300; ++repeat) {
    const int tendons = 3 + repeat % 3;
    MatrixXd a(2, tendons);
    for (double& v : a.reshaped()) v = kHoleRadius_m * (2 * uniform(random) - 1);
    VectorXd most_N(tendons), t(tendons);
    for (double& v : most_N) v = 0.3 + 8 * uniform(random) * (uniform(random) < 0.8);  // some have no room
    for (double& v : t) v = 0.3 + 8 * uniform(random);
    const VectorXd force = a * t;
    const auto result = TensionAllocator(tendons, 2).Allocate(a, force, 0.3, TendonVector(most_N));
    const Reference expected = BruteForce(a, force, 0.3, most_N);
    limited += result.status == Status::kLimitedTensionMax;
    EXPECT_NEAR(result.residual_Nm, expected.residual_Nm, 1e-13) << "case " << repeat;
    EXPECT_LT((result.tension_N - expected.tension_N).cwiseAbs().maxCoeff(), 1e-8) << "case " << repeat;
  }
  EXPECT_GT(limited, 50);
  EXPECT_LT(limited, 250);
}

TEST(Allocation, CoupledSectionsAgreeWithBruteForce) {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int per_section : {3, 4}) {
    const MatrixXd a = StraightJacobian(2, per_section);
    const int tendons = 2 * per_section;
    const TensionAllocator allocator(tendons, 4);
    for (int repeat = 0; repeat < 12; ++repeat) {
      VectorXd t(tendons);
      for (double& v : t) v = std::max(0.3, 9 * uniform(random) - 1);
      const VectorXd force = a * t * (repeat % 4 == 3 ? 2.5 : 1.0);
      const auto result = allocator.Allocate(a, force, 0.3, 8);
      const Reference expected = BruteForce(a, force, 0.3, 8);
      EXPECT_NEAR(result.residual_Nm, expected.residual_Nm, 1e-13);
      EXPECT_LT((result.tension_N - expected.tension_N).cwiseAbs().maxCoeff(), 1e-9);
    }
  }
}

TEST(Allocation, BalanceIsExactWithinBounds) {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int sections = 1; sections <= 4; ++sections) {
    for (int per_section : {3, 4}) {
      const MatrixXd a = StraightJacobian(sections, per_section);
      const TensionAllocator allocator(static_cast<int>(a.cols()), 2 * sections);
      for (int repeat = 0; repeat < 2000; ++repeat) {
        VectorXd t(a.cols());
        for (double& v : t) v = std::clamp(-4 + 14 * uniform(random), 0.3, 8.0);
        const VectorXd force = a * t;
        const auto result = allocator.Allocate(a, force, 0.3, 8);
        ASSERT_EQ(result.status, Status::kOk);
        ASSERT_LT(result.residual_Nm, 1e-15) << sections << " sections";
        ASSERT_GE(result.tension_N.minCoeff(), 0.3);
        ASSERT_LE(result.tension_N.maxCoeff(), 8.0);
        ASSERT_LE((result.tension_N.array() - 0.3).matrix().norm(), (t.array() - 0.3).matrix().norm() + 1e-9)
            << "the tensions the force came from are less";
        ASSERT_LE(result.iterations, 25);
      }
    }
  }
}

// One section, three tendons: the desired force turns once about the axis while tendons take over from each
// other.
TEST(Allocation, TensionsAreContinuousWhereTendonsTakeOver) {
  const MatrixXd a = StraightJacobian(1, 3);
  const TensionAllocator allocator(3, 2);
  // In each cone two tendons 120 degrees apart share the force; the smallest singular value of their two
  // columns is r sqrt(1/2).
  const double lipschitz = std::sqrt(2.0) / kHoleRadius_m * (1 + 1e-6);
  for (double magnitude : {1e-6, 0.005, 0.02, 0.05}) {  // the last is beyond the limits
    TendonVector previous;
    VectorXd last;
    const int steps = 20000;
    for (int i = 0; i <= steps; ++i) {
      const double angle = 2 * pi * i / steps;
      const VectorXd force = magnitude * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      const auto result = allocator.Allocate(a, force, 0.3, 8);
      if (i > 0) {
        ASSERT_LE((result.tension_N - previous).norm(), lipschitz * (force - last).norm() + 1e-12) << angle;
      }
      ASSERT_NEAR(result.tension_N.minCoeff(), 0.3, 1e-12) << "one tendon of three is always at the minimum";
      previous = result.tension_N;
      last = force;
    }
  }
}

TEST(Allocation, CoupledSectionsAreContinuous) {
  const MatrixXd a = StraightJacobian(2, 3);
  const TensionAllocator allocator(6, 4);
  TendonVector previous;
  VectorXd last;
  double worst = 0;
  for (int i = 0; i <= 40000; ++i) {
    const double t = 2 * pi * i / 40000;
    const VectorXd force = Eigen::Vector4d(0.02 * std::cos(t), 0.02 * std::sin(2 * t),
                                           0.015 * std::cos(3 * t + 1), 0.015 * std::sin(t));
    const auto result = allocator.Allocate(a, force, 0.3, 12);
    if (i > 0) worst = std::max(worst, (result.tension_N - previous).norm() / (force - last).norm());
    previous = result.tension_N;
    last = force;
  }
  // The piecewise linear map's largest slope is that of its worst active set.
  double bound = 0;
  for (int set = 1; set < 64; ++set) {
    MatrixXd free(4, 0);
    for (int j = 0; j < 6; ++j) {
      if (!(set >> j & 1)) continue;
      free.conservativeResize(4, free.cols() + 1);
      free.rightCols(1) = a.col(j);
    }
    const auto values = Eigen::JacobiSVD<MatrixXd>(free).singularValues();
    bound = std::max(bound, 1 / values[values.size() - 1]);
  }
  EXPECT_LE(worst, bound * (1 + 1e-6));
}

TEST(Allocation, TurningTheTendonsTurnsTheTensions) {
  // Relabelling tendons by one place and turning the force by 120 degrees is the same problem.
  const MatrixXd a = StraightJacobian(1, 3);
  const TensionAllocator allocator(3, 2);
  const Eigen::Rotation2Dd turn(2 * pi / 3);
  for (double angle = 0; angle < 2 * pi; angle += 0.1) {
    const Eigen::Vector2d force = 0.02 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    const auto here = allocator.Allocate(a, force, 0.3, 8).tension_N;
    const auto there = allocator.Allocate(a, turn * force, 0.3, 8).tension_N;
    for (int j = 0; j < 3; ++j) EXPECT_NEAR(there[(j + 1) % 3], here[j], 1e-12);
  }
}

// A direction in which no tension does much: what the tensions of a desired tip position look like.
TEST(Allocation, NearlyDependentForcesAreStillExact) {
  std::mt19937 random(10);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (const double weak : {1e-3, 1e-5, 1e-7}) {
    for (int repeat = 0; repeat < 20; ++repeat) {
      MatrixXd a(3, 5);
      for (double& v : a.reshaped()) v = uniform(random);
      a.row(2) = 0.3 * a.row(0) + 0.5 * a.row(1) + weak * a.row(2);
      VectorXd t(5);
      for (double& v : t) v = std::clamp(4 + 6 * uniform(random), 0.3, 8.0);
      const VectorXd force = a * t;
      const auto result = TensionAllocator(5, 3).Allocate(a, force, 0.3, 8);
      EXPECT_EQ(result.status, Status::kOk);
      EXPECT_LT(result.residual_Nm, 1e-10 * force.norm()) << "what counts as reached";
      EXPECT_LE((result.tension_N.array() - 0.3).matrix().norm(),
                (t.array() - 0.3).matrix().norm() * (1 + 1e-9));
      // Out of reach in the weak direction only: nearest but for the regularisation, which that direction
      // feels.
      const VectorXd off = force + Eigen::Vector3d(-0.3, -0.5, 1) * 0.1;
      EXPECT_LE(TensionAllocator(5, 3).Allocate(a, off, 0.3, 8).residual_Nm,
                (a * t - off).norm() * (1 + 1e-4));
    }
  }
}

TEST(Allocation, NoForceMeansMinimumEverywhere) {
  const MatrixXd a = StraightJacobian(2, 3);
  const auto result = TensionAllocator(6, 4).Allocate(a, VectorXd::Zero(4), 0.3, 8);
  EXPECT_LT((result.tension_N.array() - 0.3).abs().maxCoeff(), 1e-12);
  EXPECT_EQ(result.status, Status::kOk);
}

TEST(Allocation, EqualBoundsAndNonsenseAreAnsweredNotCrashed) {
  const MatrixXd a = StraightJacobian(1, 3);
  const TensionAllocator allocator(3, 2);
  const auto pinned = allocator.Allocate(a, Eigen::Vector2d(0.01, 0), 0.3, 0.3);
  EXPECT_LT((pinned.tension_N.array() - 0.3).abs().maxCoeff(), 1e-15);
  EXPECT_EQ(pinned.status, Status::kLimitedTensionMax);
  EXPECT_NEAR(pinned.residual_Nm, 0.01, 1e-12);
  const auto nan = allocator.Allocate(a, Eigen::Vector2d(std::nan(""), 0), 0.3, 8);
  EXPECT_EQ(nan.status, Status::kSolverFallback);
  EXPECT_TRUE(nan.tension_N.allFinite());
  const auto zero = allocator.Allocate(MatrixXd::Zero(2, 3), Eigen::Vector2d(0.01, 0), 0.3, 8);
  EXPECT_TRUE(zero.tension_N.allFinite());
  const auto unlimited =
      allocator.Allocate(a, Eigen::Vector2d(1, 0), 0.3, std::numeric_limits<double>::infinity());
  EXPECT_EQ(unlimited.status, Status::kOk);
  EXPECT_LT(unlimited.residual_Nm, 1e-13);
  EXPECT_THROW(TensionAllocator(0, 2), std::invalid_argument);
  EXPECT_THROW(TensionAllocator(kMaxTendons + 1, 2), std::invalid_argument);
}

// Within the allocation's regularisation of a bound a force is no less within reach.
TEST(Allocation, ATensionAHairFromItsBoundIsReached) {
  const MatrixXd a = StraightJacobian(1, 3);
  for (double hair_N = 1e-12; hair_N < 1e-4; hair_N *= 1.3) {
    for (const VectorXd& t :
         {VectorXd(Eigen::Vector3d(2.4, 0.3 + hair_N, 0.3)), VectorXd(Eigen::Vector3d(8, 8 - hair_N, 0.3))}) {
      const auto result = TensionAllocator(3, 2).Allocate(a, a * t, 0.3, 8);
      EXPECT_EQ(result.status, Status::kOk) << hair_N;
      EXPECT_LT((result.tension_N - t).cwiseAbs().maxCoeff(), 1e-9) << hair_N;
    }
  }
}

}  // namespace
}  // namespace tendril::model
