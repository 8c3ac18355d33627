// What a --seed may be: CLI11 takes -3 for an unsigned number, and the largest for one that is larger still.
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
        return "'" + text + "' is no seed; accepted: a whole number from 0 to 18446744073709551615; " +
               (has_sign ? "leave out the sign" : "give one of these");
      },
      "");
}

}  // namespace tendril::tools
