// What simpler ways of judging the same search would name, for comparison. Knows nothing of verdicts.
#pragma once

#include <vector>

#include "evaluator.h"
#include "search.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// The first choice of least_rmse, raw_bic, refit_everything and sparse_regression; those that choose nothing
/// are left out.
std::vector<Baseline> Baselines(const Evaluator& evaluator, const SearchResult& search);

}  // namespace tendril::gap
