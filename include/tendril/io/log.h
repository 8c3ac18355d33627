// LCM log files: the record of a run. Writer for the demo and the daemon's recorder; reader that gives cycle
// records back.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/io/gateway.h"

namespace tendril::io {

/// Writes every message that passes a gateway's connection into an LCM event log: what the gateway publishes
/// as it is published, everything else (commands, tracker) as Gateway::Handle receives it.
class LogWriter {
 public:
  /// Throws std::runtime_error naming the path when it cannot be written. Events are stamped by `clock` in
  /// microseconds (of the epoch when it is this machine's). The gateway must outlive the writer.
  LogWriter(Gateway& gateway, const std::string& path, const Clock& clock);
  ~LogWriter();
  std::uint64_t events() const;
  /// Empty, or why events could not be written (for example a full disk).
  std::string error() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Reads a log back, calling `run` and `cycle` (either may be empty) for each record as it comes: for logs of
/// any length. Stops at the first damaged event and says so in the returned text (empty: clean end). Throws
/// std::runtime_error when the file cannot be opened.
std::string StreamLog(const std::string& path, const std::function<void(const RunInfo&)>& run,
                      const std::function<void(const CycleRecord&)>& cycle);

/// The same, all at once: the last run record and every cycle (some 2 kB each).
struct LogContents {
  RunInfo run;
  std::vector<CycleRecord> cycles;
  std::string damage;
};
LogContents ReadLog(const std::string& path);

}  // namespace tendril::io
