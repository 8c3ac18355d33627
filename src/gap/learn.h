// The robot's numbers inferred from runs: the maximum of their posterior, and Laplace's approximation about
// it. Knows nothing of effects or verdicts.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "evaluator.h"
#include "free_numbers.h"
#include "linear_fit.h"
#include "score.h"

namespace tendril::gap {

/// About its maximum the posterior is taken as Gaussian: in coordinates z, x = maximum + basis z, its
/// curvature is that of the prior and of the runs.
struct LearnedNumbers {
  FreeNumbers free;
  Eigen::VectorXd x;    // changes of the numbers at the maximum, as FreeNumbers::Robot takes them
  Residuals residuals;  // there
  bool converged = false;
  int iterations = 0;
  Eigen::MatrixXd basis;        // directions of z, as columns of changes
  std::vector<Column> columns;  // d simulated / d z
  Normal normal;                // of the runs, by fold
  Eigen::MatrixXd curvature;    // of the log posterior in z, negated
  Eigen::VectorXd slope;        // of the log posterior in z: nearly zero

  /// Log of the share of the prior's volume that the posterior has: what the freedom of the numbers costs.
  double LogOccam() const;
  /// -1/2 x' precision x.
  double LogPrior() const { return -0.5 * x.dot(free.precision * x); }
};

struct LearnOptions {
  int threads = 1;
  std::function<void(double)> progress{};  // from 0 to 1, at every replay
  /// Where to begin; null: at the nominal robot, along single numbers. The directions and derivatives there
  /// are taken over; those of a free cause that it does not have are added.
  const LearnedNumbers* from = nullptr;
  /// Derivatives follow from the steps alone: for an estimate at the cost of a few replays.
  bool quick = false;
};

/// Gauss-Newton steps with the discrepancy of each channel re-estimated. Empty where the robot to begin with
/// cannot be simulated.
std::optional<LearnedNumbers> Learn(const Evaluator& evaluator, FreeNumbers free, const Folds& folds,
                                    const LearnOptions& options);

/// Residuals, of all channels, of the robot with changes `x` in some of the runs, of the nominal robot in the
/// others; empty where it cannot be simulated.
std::optional<Residuals> ResidualsWith(const Evaluator& evaluator, const FreeNumbers& free,
                                       const Eigen::VectorXd& x, const std::vector<int>& runs, int threads);

}  // namespace tendril::gap
