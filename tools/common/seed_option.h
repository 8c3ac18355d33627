// What a --seed may be: CLI11 takes -3 for an unsigned number.
// Knows the command line only.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace tendril::tools {

inline CLI::Validator Seed() {
  return CLI::Validator(
      [](std::string& text) -> std::string {
        const bool digits = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
        return digits ? "" : "'" + text + "' is no seed; accepted: a whole number from 0; leave out the sign";
      },
      "");
}

}  // namespace tendril::tools
