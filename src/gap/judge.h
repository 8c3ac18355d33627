// From scores to conclusions: the probability of each cause, which ones cannot be told apart, the verdict.
// Knows nothing of how scores were found.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "evaluator.h"
#include "file_numbers.h"
#include "search.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Probability that something else has the same effect as a cause that explains everything: no conclusion is
/// surer.
inline constexpr double kLapse = 0.03;
/// Share of a gap's mean square that a correct cause may leave, since its law is not exact: over all places,
/// and at each place of the largest gap. A cause that leaves more is not established.
inline constexpr double kMayStay = 0.1;
/// Floors beyond which what it leaves anywhere does the same.
inline constexpr double kMostLeft_sigma = 5;
/// Probability of a gap although the data show none: a small one.
inline constexpr double kUnseen = 0.3;
/// Log of the ratio of probabilities from which two causes are told apart, and the share of its group's
/// probability that names a single one.
inline constexpr double kSame = 3.0;
inline constexpr double kClear = 0.8;

struct Judgement {
  Verdict verdict = Verdict::kInsufficientData;
  std::vector<Cause> causes;
  std::vector<Cause> accepted;
  std::vector<Confusion> confusable;
  const Fit* best = nullptr;     // of the accepted model; null: none accepted
  const Fit* nearest = nullptr;  // the model that leaves leftover_sigma, accepted or not
  double leftover_sigma = 0;
  std::vector<SuspectNumber> suspected;
  std::string doubt;                  // as Diagnosis::doubt
  bool unrepeated = false;            // no place has a gap, but the robot does not repeat
  std::optional<sim::Cut> hidden_at;  // the cut without a gap at which the best two causes would cancel
};
/// `seed` of the bootstrap over blocks. `fit_numbers` fits the numbers of the robot file and is called only
/// where the causes leave part of a gap.
Judgement Judge(const Evaluator& evaluator, const SearchResult& search,
                const std::vector<CutFinding>& location, std::uint64_t seed,
                const std::function<std::vector<NumberFit>()>& fit_numbers);

}  // namespace tendril::gap
