// LCM log files: the record of a run. Writer for the demo and the daemon's recorder; reader that gives cycle records back.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/io/gateway.h"

namespace tendril::io {

/// Writes every message that passes a gateway's connection (commands included) into an LCM event log.
class LogWriter {
 public:
  /// Throws std::runtime_error naming the path when it cannot be written. Events are stamped by `clock` in microseconds.
  LogWriter(Gateway& gateway, const std::string& path, const Clock& clock);
  ~LogWriter();
  std::uint64_t events() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Reads a log back; stops at the first damaged event and says so in the returned text (empty: clean end).
struct LogContents {
  RunInfo run;
  std::vector<CycleRecord> cycles;
  std::string damage;
};
LogContents ReadLog(const std::string& path);

}  // namespace tendril::io
