// Effects by the names that people write. Knows nothing of what they do.
#pragma once

#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <numeric>
#include <string>
#include <string_view>
#include <vector>

#include "commands.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {

/// How many letters must change to make one word of the other; small and capital ones are the same.
inline std::size_t Distance(std::string_view a, std::string_view b) {
  const auto same = [](char x, char y) {
    return std::tolower(static_cast<unsigned char>(x)) == std::tolower(static_cast<unsigned char>(y));
  };
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0u);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t changed = diagonal + (same(a[i - 1], b[j - 1]) ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

/// Of a name to an effect's, or to its first words, which people write as well.
inline std::size_t Unlike(std::string_view name, std::string_view effect) {
  std::size_t least = Distance(name, effect);
  for (std::size_t at = effect.find('_'); at != effect.npos; at = effect.find('_', at + 1))
    least = std::min(least, Distance(name, effect.substr(0, at)));
  return least;
}

/// Throws UsageError with the name that is most like it.
inline const sim::Effect& EffectNamed(const std::string& name) {
  if (const sim::Effect* effect = sim::FindEffect(name)) return *effect;
  const auto effects = sim::Effects();
  const sim::Effect& nearest =
      *std::min_element(effects.begin(), effects.end(), [&](const sim::Effect& a, const sim::Effect& b) {
        return Unlike(name, a.name) < Unlike(name, b.name);
      });
  throw UsageError(fmt::format("there is no effect '{}'; did you mean {}? 'tendril gap explain' lists all {}",
                               name, nearest.name, effects.size()));
}

/// The same of the first word of an effect with its parameters; one without a name is another's business.
inline void CheckEffectNamed(const std::string& text) {
  const std::size_t from = text.find_first_not_of(' ');
  if (from == text.npos) return;
  const std::string name = text.substr(from, text.find_first_of(" \t", from) - from);
  if (name.find('=') == name.npos) EffectNamed(name);
}

}  // namespace tendril::tools
