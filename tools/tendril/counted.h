// Numbers of things in sentences: "1 run", "3 runs". Knows no other grammar.
#pragma once

#include <fmt/core.h>

#include <cstddef>
#include <string>

namespace tendril::tools {

/// `plural` only where it is not the word with an s.
inline std::string Counted(std::size_t count, const std::string& word, const std::string& plural = {}) {
  return fmt::format("{} {}", count, count == 1 ? word : plural.empty() ? word + "s" : plural);
}

}  // namespace tendril::tools
