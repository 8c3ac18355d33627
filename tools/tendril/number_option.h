// A check of options that are numbers: from one to the other, and no NaN, which comparisons let through.
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
            return fmt::format("{} is not a number from {}; {}", text, range, remedy);
          },
          range};
}

}  // namespace tendril::tools
