// The last cycles before a fault: recorded in memory by the real-time thread, written as a log by another
// thread. Knows nothing of LCM connections, threads or what a fault means.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tendril/control/controller.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/io/log.h"

namespace tendril::daemon {

/// The ring is divided into blocks, each with the controller's state before its first cycle; a log begins
/// with the oldest complete block, so that it can be replayed bit for bit. Recording pauses from a fault
/// until its log is written.
class BlackBox {
 public:
  /// Number of logs kept in the folder; older ones are removed when one is written.
  static constexpr std::size_t kLogsKept = 20;

  /// Allocates all memory: parameters.seconds of cycles and a tenth more. `controller` has taken no step yet.
  BlackBox(const BlackBoxParameters& parameters, const LcmParameters& lcm, const io::RobotShape& shape,
           const io::RunInfo& run, std::int64_t epoch_offset_us, TimeNs period_ns,
           const control::Controller& controller);

  /// Creates the folder. Returns empty text, or why logs cannot be written there and the remedy.
  std::string CheckFolder() const;

  /// Real-time thread, after each step of `controller`: no allocation, lock or system call.
  void Add(const CycleRecord& record, const control::Controller& controller) noexcept;

  /// Result of writing a log: its path (kOk), or why there is none and the remedy (kDegraded).
  struct Outcome {
    Status status = Status::kOk;
    std::string text;
  };
  /// Writer thread: writes at most `cycles` cycles of a pending log. Returns nothing until there is a result.
  /// Disk errors do not throw.
  std::optional<Outcome> WriteSome(int cycles);
  /// Whether WriteSome has work to do.
  bool full() const noexcept { return phase_.load(std::memory_order_acquire) == Phase::kFull; }

  std::size_t cycles() const noexcept { return records_.size(); }

 private:
  enum class Phase { kRecording, kFull, kWritten };

  std::byte* state_of(std::size_t block) { return states_.data() + block * state_bytes_; }
  void SaveState(std::uint64_t next_cycle, TimeNs time_ns, const control::Controller& controller) noexcept;
  void Begin();

  struct Snapshot {
    std::uint64_t next_cycle = 0;
    TimeNs time_ns = 0;  // of the previous cycle
  };

  BlackBoxParameters parameters_;
  std::string channel_prefix_;
  io::RobotShape shape_;
  io::RunInfo run_;
  std::int64_t epoch_offset_us_;
  std::size_t block_cycles_, state_bytes_;
  // kFull: the members below belong to the writer, else to the real-time thread.
  std::atomic<Phase> phase_{Phase::kRecording};

  std::vector<CycleRecord> records_;
  std::vector<Snapshot> snapshots_;  // one per block, as are the bytes
  std::vector<std::byte> states_;
  std::size_t count_ = 0;  // records since the ring was last empty
  Mode last_mode_ = Mode::kDisconnected;

  // Used by the writer thread only.
  std::unique_ptr<io::RecordLog> log_;
  std::string path_, cause_;
  std::size_t next_ = 0, first_ = 0;
};

}  // namespace tendril::daemon
