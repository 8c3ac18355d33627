// Worst-case load of the bus by a configuration.
// Knows how long frames are and how often each is sent, nothing of drives' states.
#include <cmath>
#include <cstdio>

#include "tendril/canopen/master.h"
#include "tendril/canopen/pdo.h"

namespace tendril::canopen {
namespace {

constexpr TimeNs kLongestCycle_ns = 1000 * kNsPerMs;

struct Load {
  double cyclic_bits_per_s, other_bits_per_s;
  double total() const { return cyclic_bits_per_s + other_bits_per_s; }
};

Load LoadOf(const BusParameters& bus, int drives, TimeNs cycle_ns) {
  const double sync = can::WorstCaseBits(0);
  const double pdos = can::WorstCaseBits(kRpdoTorque.bytes()) + can::WorstCaseBits(kTpdoFeedback.bytes());
  const double status_rate_Hz = 1e4 / kTpdoStatus.inhibit_100us;
  const double status = can::WorstCaseBits(kTpdoStatus.bytes()) * status_rate_Hz;
  const double heartbeat_rate_Hz = bus.heartbeat_ms > 0 ? 1e3 / bus.heartbeat_ms : 0;
  const double heartbeat = can::WorstCaseBits(1) * heartbeat_rate_Hz;
  return {(sync + drives * pdos) / ToSeconds(cycle_ns), drives * status + (drives + 1) * heartbeat};
}

}  // namespace

BusBudget ComputeBusBudget(const BusParameters& bus) {
  const int drives = static_cast<int>(bus.nodes.size());
  const double allowed = bus.max_load * bus.bitrate_bps;
  const Load load = LoadOf(bus, drives, bus.cycle_ns);
  BusBudget budget;
  budget.cyclic_bits_per_s = load.cyclic_bits_per_s;
  budget.other_bits_per_s = load.other_bits_per_s;
  budget.load = load.total() / bus.bitrate_bps;
  while (budget.max_drives_at_this_cycle < 127 &&
         LoadOf(bus, budget.max_drives_at_this_cycle + 1, bus.cycle_ns).total() <= allowed) {
    ++budget.max_drives_at_this_cycle;
  }
  for (TimeNs cycle_ns = kNsPerMs; cycle_ns <= kLongestCycle_ns; cycle_ns += kNsPerMs) {
    if (LoadOf(bus, drives, cycle_ns).total() <= allowed) {
      budget.min_cycle_ns_for_these_drives = cycle_ns;
      break;
    }
  }
  return budget;
}

std::string BusBudget::ToString() const {
  std::array<char, 256> text{};
  std::snprintf(
      text.data(), text.size(),
      "worst-case bus load %.1f %% (%.0f bit/s cyclic, %.0f bit/s other); at most %d drives fit this cycle",
      100 * load, cyclic_bits_per_s, other_bits_per_s, max_drives_at_this_cycle);
  std::string line = text.data();
  if (min_cycle_ns_for_these_drives > 0) {
    std::snprintf(text.data(), text.size(), ", and these drives fit a cycle of %d ms or longer",
                  static_cast<int>(min_cycle_ns_for_these_drives / kNsPerMs));
    line += text.data();
  }
  return line;
}

}  // namespace tendril::canopen
