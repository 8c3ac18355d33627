// Checks of options that are numbers, and no NaN, which comparisons let through.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <string>

namespace tendril::tools {

inline CLI::Validator NumberFrom(double least, double most, const char* remedy) {
  const std::string range = fmt::format("{:g} to {:g}", least, most);
  return {[=](std::string& text) {
            double value = NAN;
            if (CLI::detail::lexical_cast(text, value) && value >= least && value <= most)
              return std::string();
            const bool blank = text.find_first_not_of(' ') == text.npos;
            return fmt::format("{} is not a number from {}; {}", blank ? "'" + text + "'" : text, range,
                               remedy);
          },
          range};
}

/// CLI11's own check would print the largest number there is in full.
inline CLI::Validator Positive() {
  return CLI::Validator(
      [](std::string& text) -> std::string {
        double value = 0;
        const bool good = CLI::detail::lexical_cast(text, value) && std::isfinite(value) && value > 0;
        return good ? "" : "'" + text + "' is out of range; accepted: a number above 0, such as 0.5";
      },
      "NUMBER > 0");
}

}  // namespace tendril::tools
