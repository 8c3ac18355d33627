// Worst-case bus load of a configuration. Knows frame lengths and rates, nothing of drives' states.
#include "bus_budget.h"

#include <cmath>
#include <cstdio>

#include "tendril/canopen/master.h"

namespace tendril::canopen {
namespace {

constexpr TimeNs kLongestCycle_ns = 1000 * kNsPerMs;

struct Load {
  double cyclic_bits_per_s, other_bits_per_s, sdo_bits_per_s;
  double total() const { return cyclic_bits_per_s + other_bits_per_s; }
};

Load LoadOf(const BusParameters& bus, int drives, TimeNs cycle_ns) {
  const double sync = can::WorstCaseBits(0);
  const double status_rate_Hz = 1e4 / kTpdoStatus.inhibit_100us;
  const double status = can::WorstCaseBits(kTpdoStatus.bytes()) * status_rate_Hz;
  const double heartbeat_rate_Hz = bus.heartbeat_ms > 0 ? 1e3 / bus.heartbeat_ms : 0;
  const double heartbeat = can::WorstCaseBits(1) * heartbeat_rate_Hz;
  const double sdo = kSdoExchangeBits / (kCyclesPerSdoExchange * ToSeconds(cycle_ns));
  return {(sync + drives * kPdoBits) / ToSeconds(cycle_ns), drives * status + (drives + 1) * heartbeat + sdo,
          sdo};
}

TimeNs TimeOf(int bits, const BusParameters& bus) {
  return static_cast<TimeNs>(std::ceil(bits * 1e9 / bus.bitrate_bps));
}

}  // namespace

BusBudget ComputeBusBudget(const BusParameters& bus) {
  const int drives = static_cast<int>(bus.nodes.size());
  const double allowed = bus.max_load * bus.bitrate_bps;
  const Load load = LoadOf(bus, drives, bus.cycle_ns);
  BusBudget budget;
  budget.cyclic_bits_per_s = load.cyclic_bits_per_s;
  budget.other_bits_per_s = load.other_bits_per_s;
  budget.sdo_bits_per_s = load.sdo_bits_per_s;
  budget.load = load.total() / bus.bitrate_bps;
  // Feedback yields only to a frame already on the bus.
  budget.feedback_ns = TimeOf(
      can::WorstCaseBits(0) + drives * can::WorstCaseBits(kTpdoFeedback.bytes()) + can::WorstCaseBits(8),
      bus);
  budget.torques_ns = TimeOf(drives * can::WorstCaseBits(kRpdoTorque.bytes()), bus);
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

std::string FeedbackDeadlineProblem(const BusParameters& bus) {
  const BusBudget budget = ComputeBusBudget(bus);
  const TimeNs latest_ns = bus.cycle_ns - budget.torques_ns;
  if (bus.feedback_deadline_ns >= budget.feedback_ns && bus.feedback_deadline_ns <= latest_ns) return "";
  const bool early = bus.feedback_deadline_ns < budget.feedback_ns;
  std::array<char, 320> text{};
  const int n = std::snprintf(
      text.data(), text.size(), "%lld is too %s: at %d bit/s the %s of %d drives can take %lld ns%s; ",
      static_cast<long long>(bus.feedback_deadline_ns), early ? "early" : "late", bus.bitrate_bps,
      early ? "feedback" : "torques", static_cast<int>(bus.nodes.size()),
      static_cast<long long>(early ? budget.feedback_ns : budget.torques_ns),
      early ? " after SYNC" : ", before the next SYNC");
  const auto rest = std::span(text).subspan(static_cast<std::size_t>(n));
  if (budget.feedback_ns <= latest_ns) {
    std::snprintf(rest.data(), rest.size(), "accepted: %lld .. %lld; %s it",
                  static_cast<long long>(budget.feedback_ns), static_cast<long long>(latest_ns),
                  early ? "raise" : "lower");
  } else {
    std::snprintf(rest.data(), rest.size(),
                  "accepted: a cycle_ns of %lld or more; raise it or use fewer drives",
                  static_cast<long long>(budget.feedback_ns + budget.torques_ns));
  }
  return text.data();
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
