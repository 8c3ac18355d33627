// Our loop beside a bare timer loop, turn by turn on the same thread: what the machine gives and what of it
// is lost. Knows nothing of CAN or control.
#pragma once

#include <functional>
#include <string>

#include "tendril/rt/cyclic.h"

namespace tendril::rt {

struct LoopComparison {
  Histogram loop, timer;                            // wake latency
  std::uint64_t loop_missed = 0, timer_missed = 0;  // periods skipped
  std::string problems;                             // of EnterRealtime; empty: all rights were there
};

/// Turns of a quarter of a second each: RunCyclic with an empty body, then clock_nanosleep to the same
/// absolute grid and nothing else; together about `duration_ns`, on a thread that has entered real time as
/// asked. Ends early when `stop` (asked once a turn) returns true.
LoopComparison CompareLoops(const RealtimeParameters& parameters, TimeNs period_ns, TimeNs duration_ns,
                            const std::function<bool()>& stop);

}  // namespace tendril::rt
