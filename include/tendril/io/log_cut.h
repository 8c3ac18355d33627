// A part of an LCM log as a log of its own.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace tendril::io {

/// Times by the log's stamps, in seconds since its earliest.
struct LogSpan {
  std::optional<double> from_s, to_s;  // both included; nullopt: the log's own end
};

struct CutResult {
  std::uint64_t messages = 0, of = 0;  // written, and whole ones in the log
  double from_s = 0, to_s = 0;         // of what is written, since the log's earliest stamp
  std::string damage;                  // as LogMessages::Damage
};

/// Writes what lies in the span, unaltered and in its order, behind the last RUN message of each daemon
/// before it (stamped as the first message of the span), without which no reader knows the robot. Damage is
/// left out. The file appears when it is complete. Throws std::runtime_error where `path` cannot be read,
/// nothing lies in the span, `out` cannot be written, or a file would be lost that is no earlier cut:
/// the log itself, or one called OUT.part. `progress` as SummariseLog.
CutResult CutLog(const std::string& path, const LogSpan& span, const std::string& out,
                 const std::function<void(double)>& progress = {});

}  // namespace tendril::io
