// Linear least squares of parameters within priors and bounds, scored on held-out folds. Simulates nothing.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "evaluator.h"
#include "score.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// Derivative of the simulated values by one parameter, [run][channel][window]; channels that do not depend
/// on it are empty.
using Column = Residuals;

/// Normal equations by fold.
struct Normal {
  std::vector<Eigen::MatrixXd> A;  // sum of w j j^T
  std::vector<Eigen::VectorXd> b;  // sum of w j r
  int size() const { return static_cast<int>(A[0].rows()); }
};
/// `rest` as for LogScore.
Normal Accumulate(const std::vector<const Column*>& columns, const Residuals& part, const Residuals& rest,
                  const Weights& weights, const Folds& folds);

struct LinearFit {
  Eigen::VectorXd value;      // change of the parameters
  double score = 0;           // gain in log score on the data it was fitted to, and in log prior
  double held_out_score = 0;  // gain on held-out folds, and in log prior
};
/// Changes of parameters: a Gaussian prior with its standard deviations about its centre, and bounds.
struct Bounds {
  Eigen::VectorXd prior, center, lower, upper;

  /// For a parameter at `value`, within its own bounds.
  void Add(const sim::EffectParameter& parameter, double value);
  /// For a constant without bounds: three standard deviations about the centre, and about no change.
  void AddNuisance(double deviation, double at);
  /// Inverse of the prior covariance.
  Eigen::MatrixXd Precision() const;
  /// Log of the prior's density at a change over that at none.
  double LogPrior(const Eigen::VectorXd& change) const;
};

/// Least squares within prior and bounds. Where one of the first `own` parameters is determined by a single
/// fold only, that fold is scored with the fit to all data, less a fixed cost.
LinearFit SolveLinear(const Normal& normal, const Bounds& bounds, int own = 0);

/// Minimum of 1/2 x'Hx - g'x within bounds, fixing variables that reach a bound (few variables).
Eigen::VectorXd Bounded(const Eigen::MatrixXd& H, const Eigen::VectorXd& g, const Eigen::VectorXd& lower,
                        const Eigen::VectorXd& upper);

/// The only fold that determines one of the first `own` parameters, or -1.
int OnlyFold(const Normal& normal, int own);
/// Cost of a gap that only one fold can show, beyond what any parameter gains by chance.
constexpr double kOnlyFoldCost = 8;

}  // namespace tendril::gap
