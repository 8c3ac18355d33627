// The search for causes: screening of all candidates, refits of the best, pairs. Knows nothing of
// probabilities or words.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "evaluator.h"
#include "fit.h"
#include "hypothesis.h"
#include "probes.h"
#include "score.h"

namespace tendril::gap {

/// Log score that a second cause has to bring, as a rule.
constexpr double kPairGain = 12.0;

/// One candidate as the screening sees it.
struct Screened {
  Candidate candidate;
  Model start;               // nominal, shape parameters where the search did best
  std::vector<int> primary;  // parameters with a column
  std::vector<Column> columns;
  LinearFit linear;  // of the primaries (nuisances fitted along)
  double gain = 0;   // held-out log score over the nominal model
};

struct SearchOptions {
  int threads = 1;
  int refits = 8;
  std::function<void(double)> progress;
  /// True when these residuals leave nothing at any place: then only second causes are tried that promise
  /// kPairGain, of what is spread thinly over many.
  std::function<bool(const Residuals&)> explained;
};

struct SearchResult {
  std::vector<Screened> screened;  // by falling gain
  std::vector<Fit> fits;           // single candidates, by falling held-out score
  std::vector<Fit> pairs;          // the same
  std::vector<Fit> members;        // of the pair of the best score, each by itself
  double base_score = 0;           // held-out log score of the nominal model, nuisances free
  Residuals everything;            // held-out residuals of all numbers of the nominal file refitted (linear)
  std::vector<std::pair<Candidate, double>> everything_moved;  // by which, in plainly visible deviations
  Eigen::VectorXd leftover;  // per channel: what the best single leaves beyond the noise
  Nuisances nuisances;
};

/// Among the candidates of `probes`, of an evaluator of the same runs: how a robot answers does not depend on
/// the floors.
SearchResult Search(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
                    const std::vector<Probe>& probes);

}  // namespace tendril::gap
