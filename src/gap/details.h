// Details of a diagnosis beside its verdict: held-out curves, residual against conditions, growth with the
// horizon, correlation of the remaining residual with inputs, what each of two causes closes, how sharply
// each parameter is determined, and the next experiment.
#pragma once

#include <cstdint>
#include <vector>

#include "evaluator.h"
#include "judge.h"
#include "search.h"
#include "tendril/gap/diagnose.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Adds overlays, maps and correlations of the worst channels to d; `after` are the held-out residuals.
/// Without `model` only the nominal robot is shown.
void AddDetails(const Evaluator& evaluator, const Model* model, const Residuals& after, std::uint64_t seed,
                Diagnosis& d);

/// What each of two causes closes by itself, and in addition to the other.
void AddOrders(const Evaluator& evaluator, const SearchResult& search, const std::vector<char>& with_gap,
               std::uint64_t seed, Diagnosis& d);

/// Log score lost within four standard deviations of the estimate, for every parameter of the model.
std::vector<Profile> ProfilesOf(const Evaluator& evaluator, const Folds& folds, const SearchResult& search,
                                const Fit& fit, int threads);

/// For an ambiguous or unexplained verdict: the family of the menu that separates the rivals best, from a
/// simulation with each rival's fit, comparing them after the others are refitted.
NextExperiment FindNextExperiment(const Evaluator& evaluator, const SearchResult& search, const Diagnosis& d,
                                  const ExperimentMenu& menu, int threads);

}  // namespace tendril::gap
