// Compares this loop with a bare timer loop, in alternation on one thread: the machine's latency and the
// loop's share of it. Knows nothing of CAN or control.
#pragma once

#include <functional>
#include <string>

#include "tendril/rt/cyclic.h"

namespace tendril::rt {

struct LoopComparison {
  Histogram loop, timer;                            // wake latency
  std::uint64_t loop_missed = 0, timer_missed = 0;  // periods skipped
  std::string problems;                             // of EnterRealtime; empty: all rights were granted
};

/// Alternates a quarter of a second each: RunCyclic with an empty body, then only clock_nanosleep to the same
/// absolute grid; about `duration_ns` in all, on a thread that has entered real time as configured. Ends
/// early when `stop` (polled once per turn) returns true.
LoopComparison CompareLoops(const RealtimeParameters& parameters, TimeNs period_ns, TimeNs duration_ns,
                            const std::function<bool()>& stop);

}  // namespace tendril::rt
