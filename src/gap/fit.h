// Estimation: linear screening of a candidate from its sensitivities, full refits of a model within its
// bounds, and both judged on parts of the data that were left out. Knows nothing of verdicts.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "evaluator.h"
#include "hypothesis.h"
#include "score.h"

namespace tendril::gap {

/// Derivative of the simulated values by one parameter, [run][channel][window]; empty channels do not depend
/// on it.
using Column = Residuals;

/// Normal equations by fold.
struct Normal {
  std::vector<Eigen::MatrixXd> A;  // sum of w j j^T
  std::vector<Eigen::VectorXd> b;  // sum of w j r
  int size() const { return static_cast<int>(A[0].rows()); }
};
Normal Accumulate(const std::vector<const Column*>& columns, const Residuals& part, const Residuals& rest,
                  const Weights& weights, const Folds& folds);

struct LinearFit {
  Eigen::VectorXd value;      // change of the parameters
  double score = 0;           // log score gained by it on the data it was fitted to
  double held_out_score = 0;  // gained on folds that were left out
};
/// Changes of parameters: standard deviations of a Gaussian prior about zero, and bounds.
struct Bounds {
  Eigen::VectorXd prior, lower, upper;

  /// Of a parameter that stands at `value`, within its own bounds.
  void Add(const sim::EffectParameter& parameter, double value);
  /// Of a constant that has none: three deviations.
  void AddNuisance(double deviation);
};

/// Least squares within prior and bounds. A fold without which one of the first `own` parameters is not
/// determined cannot be predicted from the others: it is scored with what all data say, less a fixed cost.
LinearFit SolveLinear(const Normal& normal, const Bounds& bounds, int own = 0);

/// Constants that every model may change: columns with their prior standard deviations.
struct Nuisances {
  std::vector<Candidate> candidates;
  std::vector<Column> columns;
  Eigen::VectorXd prior;

  /// Those that are not themselves part of the model.
  Nuisances Beside(const Model& model) const;
};

struct Fit {
  Model model;
  bool bound_hit = false;
  int bound = -1;                        // of its sizes, one at a bound beyond which there is more of it
  int only_fold = -1;                    // the one that alone determines a parameter, and is not held out
  Residuals residuals;                   // of the channels it can change, nuisances taken out
  Residuals held_out;                    // the same when each fold is predicted by a fit to the others
  Eigen::MatrixXd covariance;            // of model.values, scaled by what is left
  Eigen::MatrixXd scatter;               // part of it: of the estimates without each fold
  std::vector<Column> columns;           // at the optimum, by parameter
  double score = 0, held_out_score = 0;  // log scores over all channels
  std::optional<double> quiet;           // taken off both: what less noise brings, see TakeOffQuiet

  /// Scores again under weights that are newer than the fit; `rest` as for LogScore.
  void Rescore(const Weights& weights, const Residuals& rest);
};

/// What a model's effects can change together, given these logs.
unsigned CutsOf(const Evaluator& evaluator, const Model& model);

/// By falling held-out score.
inline bool ByHeldOut(const Fit& a, const Fit& b) { return a.held_out_score > b.held_out_score; }

class Fitter {
 public:
  Fitter(const Evaluator& evaluator, const Folds& folds, const Weights& weights, const Nuisances& nuisances)
      : evaluator_(evaluator), folds_(folds), weights_(weights), nuisances_(nuisances) {}

  /// Refits all of a model's parameters within their bounds, from its values, by at most `iterations` steps.
  /// Throws std::runtime_error when the start cannot be simulated.
  Fit Refit(const Model& start, int iterations) const;
  /// Predicts each fold by a refit to the others, of at most `iterations` steps from the common optimum,
  /// where Refit takes one linear step: what acts otherwise a little further on is not held out by a straight
  /// line. Throws std::runtime_error when one of them cannot be simulated.
  void HoldOutByRefits(Fit& fit, int iterations) const;
  /// Log score lost when parameter k is held at `value` and everything else follows by a linear step.
  /// Throws std::runtime_error when that cannot be simulated.
  double Lost(const Fit& fit, int k, double value) const;

 private:
  const Evaluator& evaluator_;
  const Folds& folds_;
  const Weights& weights_;
  const Nuisances& nuisances_;
};

/// d simulated / d value of parameter k about the model, by a difference of `step`.
Column Sensitivity(const Evaluator& evaluator, const Model& model, int k, double step,
                   const Residuals& at_model, unsigned cuts);

}  // namespace tendril::gap
