// What these runs could not show, however large. Knows nothing of verdicts.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "evaluator.h"
#include "search.h"

namespace tendril::gap {

struct UnseenEffects {
  std::size_t searched = 0;        // effects of the library that were searched
  std::vector<std::string> names;  // of those that change no channel by half its noise floor at a plainly
                                   // visible deviation by the registry
};
UnseenEffects FindUnseenEffects(const Evaluator& evaluator, const SearchResult& search);

}  // namespace tendril::gap
