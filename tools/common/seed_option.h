// Valid values of --seed: CLI11 would accept -3 as an unsigned number, and clamp numbers that are too large.
// Knows the command line only.
#pragma once

#include <CLI/CLI.hpp>
#include <charconv>
#include <cstdint>
#include <string>

namespace tendril::tools {

inline CLI::Validator Seed() {
  return CLI::Validator(
      [](std::string& text) -> std::string {
        std::uint64_t seed = 0;
        const char* last = text.data() + text.size();
        const auto [end, error] = std::from_chars(text.data(), last, seed);
        if (error == std::errc() && end == last) return "";
        const bool has_sign = text.starts_with('-') || text.starts_with('+');
        return "'" + text + "' is not a seed; accepted: a whole number from 0 to 18446744073709551615; " +
               (has_sign ? "leave out the sign" : "give one of these");
      },
      "");
}

}  // namespace tendril::tools
