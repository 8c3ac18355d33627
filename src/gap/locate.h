// Where the gap lies: excess behind every cut. Knows nothing of causes.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/diagnosis.h"

namespace tendril::gap {

/// The noise is known to within some tens of per cent.
constexpr double kNoiseSlack = 1.3;
/// False discovery rate among the places found to have a gap, and among those that still have one with a
/// cause: overlooking what is left would name a wrong cause.
constexpr double kGapDiscoveries = 0.01, kLeftDiscoveries = 0.05;

/// "tendon:2", "section:1"; "tension", "tip position": as in CutFinding.
std::string PlaceOf(const Channel& channel, const Evaluator& evaluator);
std::string_view NameOf(Channel::Quantity quantity);

/// Excess behind every cut, in chain order, with the false discovery rate controlled over all of them.
std::vector<CutFinding> Locate(const Evaluator& evaluator, const Residuals& residuals,
                               double false_discoveries);

/// Which channels belong to places in `location` that have a gap, by index; other channels may exceed their
/// floor because runs scatter more than those that were repeated. All channels where no place has a gap.
std::vector<char> ChannelsWithGap(const Evaluator& evaluator, const std::vector<CutFinding>& location);

}  // namespace tendril::gap
