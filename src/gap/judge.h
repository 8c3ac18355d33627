// From scores to statements: where the excess lies, how probable each cause is, which cannot be told apart,
// the verdict. The constants that turn scores into probabilities are here and were set on open data sets.
#pragma once

#include <vector>

#include "evaluator.h"
#include "search.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Share of false ones among the places found to have a gap, and among those that a cause leaves with one: to
/// miss what is left is to name a wrong cause.
constexpr double kGapDiscoveries = 0.01, kLeftDiscoveries = 0.05;

/// Excess behind every cut, in chain order, with false discoveries controlled over all of them.
std::vector<CutFinding> Locate(const Evaluator& evaluator, const Residuals& residuals,
                               double false_discoveries);

struct Judgement {
  Verdict verdict = Verdict::kInsufficientData;
  std::vector<Cause> causes;
  std::vector<Cause> accepted;
  std::vector<Confusion> confusable;
  const Fit* best = nullptr;  // of the accepted model; null: none accepted
  double leftover_sigma = 0;
};
Judgement Judge(const Evaluator& evaluator, const SearchResult& search,
                const std::vector<CutFinding>& location);

/// Fraction of the excess mean square that is gone on held-out runs, by channel and pooled, with a bootstrap
/// over runs.
std::vector<Closure> Closures(const Evaluator& evaluator, const Residuals& before, const Residuals& after,
                              std::uint64_t seed);
std::optional<Estimate> PooledClosure(const Evaluator& evaluator, const Residuals& before,
                                      const Residuals& after, std::uint64_t seed);

}  // namespace tendril::gap
