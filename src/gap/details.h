// What a reader wants to see of a diagnosis beside its verdict: held-out curves, conditions under which the
// residual grows, growth with the horizon, what is left against the inputs, the run that would tell rivals
// apart.
#pragma once

#include "evaluator.h"
#include "judge.h"
#include "search.h"
#include "tendril/gap/diagnose.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Overlays, maps and correlations of the worst channels into d; `after` are the residuals held out. With
/// `model` null there is only before.
void AddDetails(const Evaluator& evaluator, const Model* model, const Residuals& after, std::uint64_t seed,
                Diagnosis& d);

/// For an ambiguous or unexplained verdict: the family of the menu that separates the rivals most, simulated
/// with each rival's fit and compared after refitting the others.
NextExperiment FindNextExperiment(const Evaluator& evaluator, const SearchResult& search, const Diagnosis& d,
                                  const ExperimentMenu& menu, int threads);

}  // namespace tendril::gap
