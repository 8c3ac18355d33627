// Static equilibria: continuation of the branch from zero load by Newton steps with the exact tangent,
// minimisation of the potential from any start, and the small vibrations about these equilibria. Knows
// nothing of where loads come from.
#include "tendril/model/statics.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

namespace tendril::model {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kConvergedStep_rad = 1e-9;     // Newton converges quadratically: the next step is rounding
constexpr double kLargestMove_rad = 0.15;       // per unit and load step: keeps the corrector on its branch
constexpr double kLargestCorrection_rad = 0.1;  // a corrector that goes farther may have left the branch
constexpr double kSmallestLoadStep = 1e-9;
constexpr int kMostLoadSteps = 4000;

struct Load {
  VectorXd tension_N;
  TipWrench tip;
};

VectorXd Residual(const Body& body, const VectorXd& q, const Load& load) {
  VectorXd held(body.dof()), pulled(body.dof());
  body.StaticForce(q, load.tip, held);
  body.TendonForce(q, load.tension_N, pulled);
  return held - pulled;
}

MatrixXd Tangent(const Body& body, const VectorXd& q, const Load& load) {
  MatrixXd k(body.dof(), body.dof());
  body.TangentStiffness(q, load.tension_N, load.tip, k);
  return k;
}

// A tip moment makes the tangent unsymmetric: then the real part decides.
double SmallestEigenvalue(const MatrixXd& k, const Load& load) {
  if (load.tip.moment_W_Nm.isZero(0))
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(k, Eigen::EigenvaluesOnly).eigenvalues()[0];
  return Eigen::EigenSolver<MatrixXd>(k, false).eigenvalues().real().minCoeff();
}

bool Stable(const MatrixXd& k, const Load& load) {
  if (load.tip.moment_W_Nm.isZero(0)) return k.llt().info() == Eigen::Success;
  return SmallestEigenvalue(k, load) > 0;
}

VectorXd Solve(const MatrixXd& k, const VectorXd& rate, const Load& load) {
  if (load.tip.moment_W_Nm.isZero(0)) return k.ldlt().solve(rate);
  return k.partialPivLu().solve(rate);
}

// Plain Newton from a start near the solution. Returns the equilibrium, or nothing when the steps do not
// shrink or move away from the start. `polish`: one step more, down to rounding.
std::optional<VectorXd> Correct(const Body& body, const Load& load, const VectorXd& start, bool polish,
                                int& iterations) {
  VectorXd q = start;
  double last = kLargestCorrection_rad;
  for (int i = 0; i < 12; ++i) {
    const VectorXd step = Tangent(body, q, load).partialPivLu().solve(Residual(body, q, load));
    ++iterations;
    const double size = step.lpNorm<Eigen::Infinity>();
    if (!(size <= 2 * last)) return std::nullopt;
    q -= step;
    if ((q - start).lpNorm<Eigen::Infinity>() > kLargestCorrection_rad) return std::nullopt;
    if (size <= kConvergedStep_rad) {
      if (polish) q -= Tangent(body, q, load).partialPivLu().solve(Residual(body, q, load));
      return q;
    }
    last = size;
  }
  return std::nullopt;
}

// Follows a branch of equilibria over lambda in [0, 1]. `at(lambda)` gives the body and its load, `rate(q)`
// the derivative of the residual's right-hand side by lambda, for the prediction. Starts at result.q, stable
// at lambda 0.
template <class At, class Rate>
void Follow(const At& at, const Rate& rate, Equilibrium& result) {
  double lambda = 0, h = 0.25;
  double stiffness_at_start = 0;
  for (int steps = 0; steps < kMostLoadSteps; ++steps) {
    const auto& [body, load] = at(lambda);
    const MatrixXd k = Tangent(body, result.q, load);
    if (steps == 0) stiffness_at_start = SmallestEigenvalue(k, load);
    const VectorXd slope = Solve(k, rate(body, result.q, load), load);
    const double fastest = slope.lpNorm<Eigen::Infinity>();
    bool accepted = false;
    while (!accepted) {
      // Near a fold the slope goes to infinity; the step goes to zero with it.
      h = std::min({h, 1 - lambda, fastest > 0 ? kLargestMove_rad / fastest : 1.0});
      if (!(h >= std::min(kSmallestLoadStep, 1 - lambda))) {
        result.load_fraction = lambda;
        result.result = SmallestEigenvalue(k, load) < 0.02 * stiffness_at_start ? StaticsResult::kBuckled
                                                                                : StaticsResult::kNoSolution;
        return;
      }
      const bool last = h >= 1 - lambda;
      const double next = last ? 1 : lambda + h;
      const auto& [next_body, next_load] = at(next);
      const int before = result.iterations;
      const auto q =
          Correct(next_body, next_load, result.q + (next - lambda) * slope, last, result.iterations);
      // An unstable point is either past the loss of stability or on another branch: a shorter step decides.
      accepted = q && Stable(Tangent(next_body, *q, next_load), next_load);
      if (!accepted) {
        h /= 2;
        continue;
      }
      result.q = *q;
      lambda = next;
      if (result.iterations - before <= 5) h *= 2;
    }
    if (lambda >= 1) {
      result.load_fraction = 1;
      result.result = StaticsResult::kConverged;
      return;
    }
  }
  result.load_fraction = lambda;
  result.result = StaticsResult::kNoSolution;
}

// Applies the dead loads, first of all the robot's weight, gradually to the rest shape: the start of the
// branch.
void Sag(const Body& body, Equilibrium& result) {
  const Load none{VectorXd::Zero(body.tendons()), {}};
  const int n = body.dof();
  result.q.resize(n);
  body.RestShape(result.q);
  const auto at = [&](double lambda) {
    BodyParameters parameters = body.parameters();
    parameters.gravity_W_mps2 *= lambda;
    parameters.tip_force_W_N *= lambda;
    return std::pair<Body, Load>(Body(parameters), none);
  };
  const auto rate = [&](const Body&, const VectorXd& q, const Load&) {
    VectorXd all(n), elastic(n);
    body.StaticForce(q, Vector3d::Zero(), all);
    body.ElasticForce(q, elastic);
    return VectorXd(elastic - all);
  };
  Follow(at, rate, result);
}

double Potential(const Body& body, const VectorXd& q, const Load& load, Body::Workspace& workspace) {
  const Energy energy = body.EnergyOf(q, VectorXd::Zero(body.dof()), workspace);
  VectorXd length(body.tendons());
  body.TendonLengths(q, length);
  return energy.elastic + energy.gravity + load.tension_N.dot(length) -
         load.tip.force_W_N.dot(body.TipPose(q).p_WA);
}

}  // namespace

Equilibrium SolveStatics(const Body& body, ConstVectorRef tension_N, const TipWrench& tip) {
  Equilibrium result;
  const Load full{tension_N, tip};
  Sag(body, result);
  if (result.result != StaticsResult::kConverged) {
    result.load_fraction = 0;
    result.residual_Nm = Residual(body, result.q, full).lpNorm<Eigen::Infinity>();
    return result;
  }
  const auto part = [&](double lambda) {
    return Load{lambda * full.tension_N, {lambda * tip.force_W_N, lambda * tip.moment_W_Nm}};
  };
  const auto at = [&](double lambda) { return std::pair<const Body&, Load>(body, part(lambda)); };
  const auto rate = [&](const Body&, const VectorXd& q, const Load&) {
    VectorXd pulled(body.dof()), with_tip(body.dof()), without(body.dof());
    body.TendonForce(q, full.tension_N, pulled);
    body.StaticForce(q, full.tip, with_tip);
    body.StaticForce(q, Vector3d::Zero(), without);
    return VectorXd(pulled + without - with_tip);
  };
  Follow(at, rate, result);
  result.residual_Nm = Residual(body, result.q, part(result.load_fraction)).lpNorm<Eigen::Infinity>();
  return result;
}

Equilibrium SolveStaticsFrom(const Body& body, ConstVectorRef start_q, ConstVectorRef tension_N,
                             const Vector3d& tip_force_W_N) {
  constexpr int kMostIterations = 300;
  constexpr double kLongestStep_rad = 0.5;
  const Load load{tension_N, tip_force_W_N};
  Body::Workspace workspace(body);
  Equilibrium result;
  result.q = start_q;
  VectorXd g = Residual(body, result.q, load);
  double potential = Potential(body, result.q, load, workspace);
  while (result.iterations < kMostIterations) {
    ++result.iterations;
    const MatrixXd k = Tangent(body, result.q, load);
    const Eigen::LLT<MatrixXd> llt(k);
    const bool stable = llt.info() == Eigen::Success;
    VectorXd step;
    if (stable) {
      step = -llt.solve(g);
    } else {
      // Downhill along every mode, including those of negative curvature.
      const Eigen::SelfAdjointEigenSolver<MatrixXd> modes(k);
      const VectorXd curvature =
          modes.eigenvalues().cwiseAbs().cwiseMax(1e-6 * modes.eigenvalues().cwiseAbs().maxCoeff());
      step = -modes.eigenvectors() * (modes.eigenvectors().transpose() * g).cwiseQuotient(curvature);
    }
    const double size = step.lpNorm<Eigen::Infinity>();
    if (!std::isfinite(size)) break;
    if (size <= kConvergedStep_rad) {
      if (stable) result.q += step;
      result.result = stable ? StaticsResult::kConverged : StaticsResult::kBuckled;
      result.load_fraction = 1;
      break;
    }
    double t = std::min(1.0, kLongestStep_rad / size);
    const double slope = g.dot(step), norm = g.norm();
    bool moved = false;
    for (; t > 1e-12; t /= 2) {
      const VectorXd q = result.q + t * step;
      const VectorXd next_g = Residual(body, q, load);
      const double next = Potential(body, q, load, workspace);
      // Close to the minimum the potential no longer resolves a step; the residual still does.
      if (next <= potential + 1e-4 * t * slope ||
          (next <= potential + 1e-14 * std::abs(potential) && next_g.norm() < 0.5 * norm)) {
        result.q = q;
        g = next_g;
        potential = next;
        moved = true;
        break;
      }
    }
    if (!moved) break;
  }
  result.residual_Nm = Residual(body, result.q, load).lpNorm<Eigen::Infinity>();
  return result;
}

VectorXd NaturalFrequencies(const Body& body, ConstVectorRef equilibrium_q, ConstVectorRef tension_N,
                            const Vector3d& tip_force_W_N) {
  Body::Workspace workspace(body);
  const Load load{tension_N, tip_force_W_N};
  MatrixXd mass(body.dof(), body.dof());
  body.MassMatrix(equilibrium_q, mass, workspace);
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> modes(Tangent(body, equilibrium_q, load), mass,
                                                                 Eigen::EigenvaluesOnly);
  return modes.eigenvalues().unaryExpr([](double square) {
    return std::copysign(std::sqrt(std::abs(square)) / (2 * std::numbers::pi), square);
  });
}

std::string WhyNoEquilibrium(const Equilibrium& found) {
  if (found.result == StaticsResult::kConverged) return {};
  const bool buckled = found.result == StaticsResult::kBuckled;
  if (buckled && found.load_fraction <= 0) {
    return "no stable equilibrium: the robot buckles under its own weight before any tension acts; "
           "make it stiffer, lighter or shorter, or turn gravity";
  }
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(),
                buckled
                    ? "no stable equilibrium: the branch from zero tension buckles at %.6g %% of the load; "
                      "lower the tensions"
                    : "no equilibrium: the branch from zero tension could be followed only to %.6g %% of the "
                      "load; lower the tensions",
                100 * found.load_fraction);
  return text.data();
}

}  // namespace tendril::model
