// Estimation: full refits of a model within its bounds, scored on held-out data. Knows nothing of verdicts.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "evaluator.h"
#include "hypothesis.h"
#include "linear_fit.h"
#include "score.h"

namespace tendril::gap {

/// A constant that every model may adjust, about the robot of the evaluator.
struct Nuisance {
  const sim::Effect* effect = nullptr;  // that it is a parameter of; null: numbers of the robot file together
  std::shared_ptr<const Column> column;
  double prior = 0;   // standard deviation
  double center = 0;  // of the prior
};

struct Nuisances : std::vector<Nuisance> {
  /// Those that are not parameters of the model itself.
  Nuisances Beside(const Model& model) const;
  void AddTo(std::vector<const Column*>& columns, Bounds& bounds) const;
};

struct Fit {
  Model model;
  bool bound_hit = false;
  int bound = -1;               // a size parameter at a bound beyond which the effect is larger; -1: none
  int only_fold = -1;           // the fold that alone determines a parameter and is not held out; -1: none
  Residuals residuals;          // of the channels it can change, nuisances subtracted
  Residuals held_out;           // the same when each fold is predicted by a fit to the others
  Eigen::MatrixXd covariance;   // of model.values, scaled by the remaining residual
  Eigen::MatrixXd scatter;      // jackknife part of it, from the estimates without each fold
  std::vector<Column> columns;  // at the optimum, by parameter
  Eigen::VectorXd nuisances;    // their changes, at the optimum
  double log_prior = 0;         // of the nuisances, over that at no change
  double score = 0, held_out_score = 0;  // log scores over all channels, with it
  std::optional<double> quiet;           // subtracted from both: gain by less noise, see SubtractNoiseGain

  /// Recomputes the scores with newer weights; `rest` as for LogScore.
  void Rescore(const Weights& weights, const Residuals& rest);
};

/// The cuts that the model's effects can change together, given these logs.
unsigned CutsOf(const Evaluator& evaluator, const Model& model);

/// By falling held-out score.
inline bool ByHeldOut(const Fit& a, const Fit& b) { return a.held_out_score > b.held_out_score; }

class Fitter {
 public:
  Fitter(const Evaluator& evaluator, const Folds& folds, const Weights& weights, const Nuisances& nuisances)
      : evaluator_(evaluator), folds_(folds), weights_(weights), nuisances_(nuisances) {}

  /// Refits all parameters of a model within their bounds, starting at its values, with at most `iterations`
  /// steps. Throws std::runtime_error when the start cannot be simulated.
  Fit Refit(const Model& start, int iterations) const;
  /// Predicts each fold by a refit to the others with at most `iterations` steps from the common optimum,
  /// where Refit takes one linear step only, which is inaccurate for strongly nonlinear effects. Throws
  /// std::runtime_error when one of them cannot be simulated.
  void HoldOutByRefits(Fit& fit, int iterations) const;
  /// Log score lost when parameter k is held at `value` and everything else follows by a linear step. Throws
  /// std::runtime_error when that cannot be simulated.
  double Lost(const Fit& fit, int k, double value) const;

 private:
  /// Completes a fit at its optimum, where its residuals are `at`: nuisances, held-out residuals, scores and
  /// covariance, by one linear step without each fold.
  void HoldOutByStep(const Model& start, const Residuals& at, Fit& fit) const;

  const Evaluator& evaluator_;
  const Folds& folds_;
  const Weights& weights_;
  const Nuisances& nuisances_;
};

/// d simulated / d value of parameter k at the model, by a finite difference of size `step`; `at_model` by
/// the same `steps` of the body.
Column Sensitivity(const Evaluator& evaluator, const Model& model, int k, double step,
                   const Residuals& at_model, unsigned cuts,
                   sim::Replay::Steps steps = sim::Replay::Steps::kFine);

}  // namespace tendril::gap
