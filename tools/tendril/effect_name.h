// Effects by the names that people write. Knows nothing of what they do.
#pragma once

#include <fmt/core.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <string_view>

#include "commands.h"
#include "tendril/config/command_line.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {

/// Of a name to an effect's, or to its first words, which people write as well.
inline std::size_t Unlike(std::string_view name, std::string_view effect) {
  std::size_t least = config::LettersApart(name, effect);
  for (std::size_t at = effect.find('_'); at != effect.npos; at = effect.find('_', at + 1))
    least = std::min(least, config::LettersApart(name, effect.substr(0, at)));
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

/// What `read` throws of an effect's name or values, as wrong use of this option.
template <class Read>
auto ReadFor(const char* option, const Read& read) {
  try {
    return read();
  } catch (const std::invalid_argument& e) {
    throw UsageError(fmt::format("{}: {}", option, e.what()));
  } catch (const UsageError& e) {
    throw UsageError(fmt::format("{}: {}", option, e.what()));
  }
}

}  // namespace tendril::tools
