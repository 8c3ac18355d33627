// LCM log files: the record of a run. Writer for the demo and the daemon's recorder; reader that returns
// cycle records.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/io/gateway.h"

namespace tendril::io {

/// Writes every message on a gateway's connection into an LCM event log: the gateway's own as they are
/// published, all others (commands, tracker) as Gateway::Handle receives them, without what the daemons of
/// other robots publish on the same address.
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

/// Writes given records, without a gateway: for logs made afterwards. Events are stamped with their cycle's
/// time.
class RecordLog {
 public:
  /// Throws std::runtime_error naming the path when it cannot be written. `epoch_offset_us` as
  /// EpochOffsetUs of the clock that the records' times are of.
  RecordLog(const std::string& path, const RobotShape& shape, const std::string& channel_prefix,
            std::int64_t epoch_offset_us);
  ~RecordLog();
  void Run(const RunInfo& run, TimeNs time_ns);
  /// The controller's state after the cycle at `time_ns` and before `next_cycle`.
  void Snapshot(std::uint64_t next_cycle, TimeNs time_ns, std::span<const std::byte> state);
  void Cycle(const CycleRecord& record);
  /// Empty, or why the log is incomplete on disk. No writes are allowed afterwards.
  std::string Close();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

struct StateSnapshot {
  std::uint64_t next_cycle = 0;
  std::vector<std::byte> state;
};

/// Reads a log back, calling `run`, `cycle` (with the offset of its event in the file) and `snapshot` (any
/// may be empty) for each record in order: for logs of any length. Continues after damage; the returned line
/// names the damaged places by offset, and how much was read (empty: undamaged). Of a log with records of
/// several daemons, as other LCM tools write it, the first daemon's are read. Throws std::runtime_error when
/// the file cannot be opened.
std::string StreamLog(const std::string& path, const std::function<void(const RunInfo&)>& run,
                      const std::function<void(const CycleRecord&, std::uint64_t offset)>& cycle,
                      const std::function<void(const StateSnapshot&)>& snapshot = {});

/// The same, returned at once: the last run record and every cycle (some 2 kB each).
struct LogContents {
  RunInfo run;
  std::vector<CycleRecord> cycles;
  std::vector<std::uint64_t> offsets;  // of each cycle's event in the file
  std::string damage;
};
LogContents ReadLog(const std::string& path);

}  // namespace tendril::io
