// The machine's settings that determine a loop's latency: kernel, governor, C-states, CPUs, interrupts,
// limits, CAN queue, each with the remedy. Reads /proc and /sys only; changes nothing and measures nothing.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/limits.h"

namespace tendril::rt {

/// Length of a CAN interface's transmit queue for the frames of two cycles: SYNC, one torque per drive, a
/// heartbeat and an SDO request, for the most drives a robot has. A much longer queue would hold outdated
/// torques.
inline constexpr int kTransmitQueue = 2 * (kMaxTendons + 3);

enum class Verdict {
  kGood,
  kUnknown,  // not available on this machine
  kBetter,   // works, with avoidable latency
  kBad,      // the loop cannot meet its configuration
};

struct HostSetting {
  std::string name;  // "governor"
  Verdict verdict = Verdict::kUnknown;
  std::string value;   // as read
  std::string remedy;  // one command or kernel parameter; empty when good
};

/// `root` is "" for this machine, else a folder with a copy of its /proc and /sys. `interface` is the CAN
/// interface of `drives` drives; empty: none is checked. Never throws for unreadable settings: they are
/// kUnknown.
std::vector<HostSetting> ReadHost(const std::string& root, const RealtimeParameters& parameters,
                                  const std::string& interface, int drives);

}  // namespace tendril::rt
