// What simpler methods would name from the same search, for comparison. Knows nothing of verdicts.
#pragma once

#include <vector>

#include "evaluator.h"
#include "search.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// The first choices of least_rmse, raw_bic, refit_everything and sparse_regression; a method that chooses
/// nothing is omitted.
std::vector<Baseline> Baselines(const Evaluator& evaluator, const SearchResult& search);

}  // namespace tendril::gap
