// Runs the controller again on the inputs of a log and compares what it puts out, bit by bit, with what was
// logged. Knows nothing of buses, plants or LCM connections.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::tools {

struct Difference {
  std::uint64_t cycle = 0;
  TimeNs time_ns = 0;
  std::uint64_t offset = 0;      // of the cycle's event in the log
  std::uint64_t agree = 0;       // cycles checked after it, if all are the same to the last bit; else 0
  std::string field;             // as in cycle_t, with the index: tension_desired_base_N[2]
  std::string logged, replayed;  // the values, for people
  int bit = 0;                   // the lowest that differs; 0 is the least significant
};

struct ReplayResult {
  std::uint64_t replayed = 0;                     // cycles up to the first difference
  std::uint64_t unchecked = 0;                    // cycles after a gap, whose state is not known
  std::uint64_t first_cycle = 0, last_cycle = 0;  // of those replayed
  bool from_snapshot = false;                     // the log began in the middle of a run
  std::string version, git_revision;              // of the program that wrote the log
  std::optional<Difference> difference;           // the first
  std::string damage;                             // what of the log could not be read: io::StreamLog
};

/// The first field of the outputs, in flow order, whose bits differ. NaNs are equal when their bits are.
std::optional<Difference> FirstDifference(const CycleOutput& logged, const CycleOutput& replayed);

/// Begins at cycle 0 or at a snapshot, stops comparing at a gap; a later snapshot closes it. Behind the first
/// difference it goes on, to tell a cycle that is damaged in the log from another controller. `robot` and
/// `parameters` replace the log's own; not for logs that begin with a snapshot. Throws std::runtime_error
/// when the log holds nothing that can be replayed, and says why.
ReplayResult ReplayLog(const std::string& path, const std::optional<RobotParameters>& robot = {},
                       const std::optional<DaemonParameters>& parameters = {});

}  // namespace tendril::tools
