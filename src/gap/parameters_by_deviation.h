// The order in which a cause's parameters are listed: the largest deviation first. Knows nothing of
// formatting.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "hypothesis.h"
#include "tendril/gap/diagnosis.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// A cause's parameters by their deviation from nominal, in plainly visible deviations of the reference rig;
/// shape parameters (a time constant, a direction) come last.
inline std::vector<std::pair<std::string, Estimate>> ParametersByDeviation(const Cause& cause) {
  const sim::Effect* effect = sim::FindEffect(cause.effect);
  const auto rank = [&](const std::pair<std::string, Estimate>& named) {
    if (effect == nullptr) return std::pair(true, 0.0);
    const auto p = std::find_if(effect->parameters.begin(), effect->parameters.end(),
                                [&](const sim::EffectParameter& q) { return q.name == named.first; });
    if (p == effect->parameters.end()) return std::pair(true, 0.0);
    return std::pair(p->shape, -std::abs(named.second.value - p->nominal) / ScaleOf(*p));
  };
  std::vector<std::pair<std::string, Estimate>> sorted(cause.parameters.begin(), cause.parameters.end());
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
  return sorted;
}

}  // namespace tendril::gap
