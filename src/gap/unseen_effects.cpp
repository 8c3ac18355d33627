// The largest response of each effect, from the screening's columns.
#include "unseen_effects.h"

#include <algorithm>
#include <cmath>

namespace tendril::gap {

UnseenEffects FindUnseenEffects(const Evaluator& evaluator, const SearchResult& search) {
  constexpr double kSeen = 0.5;
  UnseenEffects unseen;
  for (const sim::Effect& effect : sim::Effects()) {
    double most = 0;
    bool searched = false;
    for (const auto& s : search.screened) {
      if (s.candidate.effect != &effect) continue;
      searched = true;
      for (std::size_t k = 0; k < s.columns.size(); ++k) {
        const double deviation = ScaleOf(s.start.parameter(s.primary[k]));
        for (int c = 0; c < static_cast<int>(evaluator.channels().size()); ++c) {
          double square = 0, count = 0;
          for (const auto& run : s.columns[k]) {
            if (run.empty() || run[c].size() == 0) continue;
            square += run[c].squaredNorm();
            count += static_cast<double>(run[c].size());
          }
          if (count > 0)
            most = std::max(most, deviation * std::sqrt(square / count) / evaluator.channels()[c].floor);
        }
      }
    }
    unseen.searched += searched ? 1 : 0;
    if (searched && most < kSeen) unseen.names.emplace_back(effect.name);
  }
  return unseen;
}

}  // namespace tendril::gap
