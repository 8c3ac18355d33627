// What an LCM log holds, without what the messages say: channels, times, gaps, damage. For logs of any
// length.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tendril/io/gateway.h"

namespace tendril::io {

/// A stretch of a log without messages, between two stamps.
struct LogGap {
  std::int64_t begin_us = 0, end_us = 0;
  double seconds() const { return 1e-6 * static_cast<double>(end_us - begin_us); }
};

struct ChannelSummary {
  std::string name;
  std::string type;  // of lcm_types; empty: of another program or version
  std::uint64_t messages = 0, bytes = 0;
  std::int64_t first_us = 0, last_us = 0;
  LogGap longest;                    // between two of its messages
  std::uint64_t earlier = 0;         // messages stamped before the one ahead of them
  std::uint64_t missing_cycles = 0;  // of a channel of cycles: left out by their numbers
  /// Messages a second between the first and the last; 0: not known.
  double rate_per_s() const;
};

/// One start of a daemon, by its RUN messages.
struct LoggedRun {
  std::string prefix;  // of its channels
  RunInfo info;
};

struct LogSummary {
  std::uint64_t file_bytes = 0, messages = 0;
  std::int64_t first_us = 0, last_us = 0;
  std::vector<ChannelSummary> channels;  // by name
  std::vector<LoggedRun> runs;
  std::uint64_t gaps = 0;          // stretches in which nothing at all was recorded
  std::vector<LogGap> first_gaps;  // of those, up to kGapsKept
  std::string damage;              // as LogMessages::Damage
  double seconds() const { return 1e-6 * static_cast<double>(last_us - first_us); }
};

inline constexpr std::size_t kGapsKept = 20;

/// `least_gap_s`: silence that counts as a gap. `progress` gets the share that is read; it may throw to end
/// the work. Throws std::runtime_error naming the path when it cannot be read.
LogSummary SummariseLog(const std::string& path, double least_gap_s,
                        const std::function<void(double)>& progress = {});

}  // namespace tendril::io
