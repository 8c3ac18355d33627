// Is a machine punctual enough for a cycle: judged from what was measured and read of it. Measures nothing
// itself.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/clock.h"
#include "tendril/rt/compare.h"
#include "tendril/rt/host.h"

namespace tendril::rt {

struct Judgement {
  bool fit = true;
  std::vector<std::string> reasons;  // why not
  std::string limit;                 // what could not be judged; empty: nothing
};

/// Fit without missed cycles, when the latest wake-up takes a fifth of the cycle at most and all but one in a
/// thousand a twentieth, measured with real-time rights on a machine without bad settings. One in a thousand
/// is judged from 2000 cycles on.
Judgement Judge(TimeNs cycle_ns, const LoopComparison& measured, const std::vector<HostSetting>& settings);

/// "good", "unknown", "could be better", "bad".
const char* VerdictText(Verdict verdict);

}  // namespace tendril::rt
