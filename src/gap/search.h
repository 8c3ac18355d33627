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

/// Log score that a second cause normally has to add.
constexpr double kPairGain = 12.0;

/// One candidate as seen by the screening.
struct Screened {
  Candidate candidate;
  Model start;               // nominal, with the best shape parameters found
  std::vector<int> primary;  // parameters with a column
  std::vector<Column> columns;
  LinearFit linear;  // of the primaries (nuisances fitted too)
  double gain = 0;   // held-out log score relative to the nominal model
};

struct SearchOptions {
  int threads = 1;
  int refits = 8;
  bool pairs = true;  // are searched too
  std::function<void(double)> progress;
  Nuisances numbers{};  // of the robot file, where they were learned from the runs
  /// True when these residuals leave no excess at any place: only second causes that promise kPairGain are
  /// tried then, for small excesses spread over many places.
  std::function<bool(const Residuals&)> explained;
};

struct SearchResult {
  std::vector<Screened> screened;  // by falling gain
  std::vector<Fit> fits;           // single candidates, by falling held-out score
  std::vector<Fit> pairs;          // by falling held-out score
  std::vector<Fit> members;        // members of the best pair, each fitted alone
  double base_score = 0;           // held-out log score of the nominal model, nuisances free
  Residuals everything;  // held-out residuals with all numbers of the nominal file refitted (linear)
  std::vector<std::pair<Candidate, double>> everything_moved;  // their changes, in plainly visible deviations
  Eigen::VectorXd leftover;  // per channel: residual of the best single cause beyond the noise
  Nuisances nuisances;
};

/// The screening alone: `screened`, `nuisances` and `leftover` of the result.
SearchResult ScreenOnly(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
                        const std::vector<Probe>& probes);

/// True where the best single fit contains all of `cause`, or the best pair where that is clearly better.
bool ContainsCause(const SearchResult& search, const Model& cause);

/// The best single causes, of different effects.
std::vector<Model> LikelyCauses(const SearchResult& search);

/// Searches among the candidates of `probes`, which may come from another evaluator of the same runs:
/// responses do not depend on the floors.
SearchResult Search(const Evaluator& evaluator, const Folds& folds, const SearchOptions& options,
                    const std::vector<Probe>& probes);

}  // namespace tendril::gap
