// What on this machine decides how punctual a loop can be: kernel, governor, C-states, CPUs, interrupts,
// limits, CAN queue, each with what to change. Reads /proc and /sys only; changes nothing and measures
// nothing.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/limits.h"

namespace tendril::rt {

/// Room that a CAN interface's transmit queue needs for the frames of two cycles, and may have: SYNC, a
/// torque a drive, a heartbeat and an SDO request, of as many drives as any robot has. Much more would keep
/// torques of long ago.
inline constexpr int kTransmitQueue = 2 * (kMaxTendons + 3);

enum class Verdict {
  kGood,
  kUnknown,  // this machine does not say
  kBetter,   // works, and could be more punctual
  kBad,      // the loop cannot do what its configuration asks for
};

struct HostSetting {
  std::string name;  // "governor"
  Verdict verdict = Verdict::kUnknown;
  std::string value;   // as read, for people
  std::string remedy;  // one command or kernel parameter; empty when good
};

/// `root` is "" for this machine, else a folder that holds a copy of its /proc and /sys. `interface` is the
/// CAN interface, over which `drives` drives are run; empty: none is looked at. Never throws for what cannot
/// be read: that is kUnknown.
std::vector<HostSetting> ReadHost(const std::string& root, const RealtimeParameters& parameters,
                                  const std::string& interface, int drives);

}  // namespace tendril::rt
