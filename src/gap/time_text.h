// Times as text: ISO 8601 dates and times of day. Knows nothing of tables.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace tendril::gap {

/// A point in time, in ns since 1970-01-01: UTC where an offset is written (Z, +02:00, +0200, +02), else by
/// the writer's clock.
struct Moment {
  std::int64_t ns = 0;
  bool with_offset = false;
};

/// YYYY-MM-DD, then T or a space, HH:MM[:SS[.fraction]] (point or comma), optionally with an offset.
std::optional<Moment> ParseIso8601(std::string_view text);

/// HH:MM:SS[.fraction] (point or comma), optionally AM or PM, in ns since midnight; hours above 23 mean a
/// stopwatch.
std::optional<std::int64_t> ParseClock(std::string_view text);

/// Unwraps clock times at midnight: each lies within half a day of the one before, unless any is beyond 24 h
/// (a stopwatch, which has no midnight). Returns the row of the first midnight passed, or -1.
int PassMidnights(std::vector<std::optional<std::int64_t>>& ns);

}  // namespace tendril::gap
