// Runs the controller on the inputs of a log and compares its outputs bit by bit with the logged ones. Knows
// nothing of buses, plants or LCM connections.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::experiment {

struct Difference {
  std::uint64_t cycle = 0;
  TimeNs time_ns = 0;
  std::uint64_t offset = 0;  // of the cycle's event in the log
  std::uint64_t agree = 0;   // cycles checked after it, if all are equal to the last bit; else 0
  // Where what follows from the drives' values of the cycle alone differs: cycles checked after it, if it
  // does in none of them; else 0.
  std::uint64_t readings_agree = 0;
  std::string field;             // as in cycle_t, with the index: tension_desired_base_N[2]
  std::string logged, replayed;  // the values as text
  int bit = 0;                   // the lowest bit that differs; 0 is the least significant
};

/// The first gap: `cycle` should come, `found` comes, less where cycles begin again, with the event at
/// `offset`.
struct MissingCycles {
  std::uint64_t cycle = 0, found = 0, offset = 0;
};

struct ReplayResult {
  std::uint64_t replayed = 0;                     // cycles up to the first difference
  std::uint64_t unchecked = 0;                    // cycles after a gap, whose state is unknown
  MissingCycles missing;                          // where unchecked > 0
  std::uint64_t first_cycle = 0, last_cycle = 0;  // of the replayed cycles
  bool from_snapshot = false;                     // the log began in the middle of a run
  std::string version, git_revision;              // of the program that wrote the log
  std::optional<Difference> difference;           // the first
  std::string damage;                             // unreadable parts of the log: io::StreamLog
};

/// The first field of the outputs, in flow order, whose bits differ. NaNs are equal when their bits are.
std::optional<Difference> FirstDifference(const CycleOutput& logged, const CycleOutput& replayed);

/// Begins at cycle 0 or at a snapshot and stops comparing at a gap, until a later snapshot. Continues after
/// the first difference, to distinguish a damaged cycle in the log from a different controller. `robot` and
/// `parameters` replace the log's own; not for logs that begin with a snapshot. Throws std::runtime_error
/// with the reason when nothing can be replayed.
ReplayResult ReplayLog(const std::string& path, const std::optional<RobotParameters>& robot = {},
                       const std::optional<DaemonParameters>& parameters = {});

}  // namespace tendril::experiment
