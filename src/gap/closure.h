// How far the gap shrinks: excess mean square before and after, with intervals. Knows nothing of causes.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// Fraction of the excess mean square that is removed on held-out runs, by channel and pooled, with a
/// bootstrap over runs. Only channels in `with_gap` (ChannelsWithGap) whose excess passes delta count.
std::vector<Closure> Closures(const Evaluator& evaluator, const Residuals& before, const Residuals& after,
                              const std::vector<char>& with_gap, std::uint64_t seed);
/// For the runs in `only`, or all when it is empty.
std::optional<Estimate> PooledClosure(const Evaluator& evaluator, const Residuals& before,
                                      const Residuals& after, const std::vector<char>& with_gap,
                                      std::uint64_t seed, const std::vector<int>& only = {});
/// By family, in order of first appearance.
std::vector<FamilyClosure> ClosuresByFamily(const Evaluator& evaluator, const Residuals& before,
                                            const Residuals& after, const std::vector<char>& with_gap,
                                            std::uint64_t seed);

}  // namespace tendril::gap
