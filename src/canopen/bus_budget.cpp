// Worst-case bus load of a configuration. Knows frame lengths and rates, nothing of drives' states.
#include "bus_budget.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "tendril/canopen/master.h"

namespace tendril::canopen {
namespace {

constexpr TimeNs kLongestCycle_ns = 1000 * kNsPerMs;

struct Load {
  double cyclic_bits_per_s, other_bits_per_s, sdo_bits_per_s;
  double total() const { return cyclic_bits_per_s + other_bits_per_s; }
};

/// Bits per second of a drive's statusword where it is sent on change.
double StatusBits_ps(const PdoLayout& status) {
  if (status.transmission == 1) return 0;
  return can::WorstCaseBits(status.bytes()) * 1e4 / status.inhibit_100us;
}

/// The PDOs of every drive, those that need most of the bus first.
std::vector<DrivePdos> Ordered(std::span<const DriveSetup> drives) {
  std::vector<DrivePdos> pdos;
  for (const DriveSetup& drive : drives) pdos.push_back(drive.profile->pdos);
  std::stable_sort(pdos.begin(), pdos.end(),
                   [](const DrivePdos& a, const DrivePdos& b) { return PdoBits(a) > PdoBits(b); });
  if (pdos.empty()) pdos.push_back(Epos4Profile()->pdos);
  return pdos;
}

/// Of the first `count` drives; those beyond the list are as its first one.
Load LoadOf(const BusParameters& bus, std::span<const DrivePdos> pdos, int count, TimeNs cycle_ns) {
  double pdo_bits = 0, status_bits_ps = 0;
  for (int i = 0; i < count; ++i) {
    const DrivePdos& drive = pdos[i < static_cast<int>(pdos.size()) ? static_cast<std::size_t>(i) : 0];
    pdo_bits += PdoBits(drive);
    status_bits_ps += StatusBits_ps(drive.status);
  }
  const double sync = can::WorstCaseBits(0);
  const double heartbeat_rate_Hz = bus.heartbeat_ms > 0 ? 1e3 / bus.heartbeat_ms : 0;
  const double heartbeat = can::WorstCaseBits(1) * heartbeat_rate_Hz;
  const double sdo = kSdoExchangeBits / (kCyclesPerSdoExchange * ToSeconds(cycle_ns));
  return {(sync + pdo_bits) / ToSeconds(cycle_ns), status_bits_ps + (count + 1) * heartbeat + sdo, sdo};
}

TimeNs TimeOf(int bits, const BusParameters& bus) {
  return static_cast<TimeNs>(std::ceil(bits * 1e9 / bus.bitrate_bps));
}

}  // namespace

BusBudget ComputeBusBudget(const BusParameters& bus, std::span<const DriveSetup> drives) {
  const int count = static_cast<int>(drives.size());
  const std::vector<DrivePdos> pdos = Ordered(drives);
  const double allowed = bus.max_load * bus.bitrate_bps;
  const Load load = LoadOf(bus, pdos, count, bus.cycle_ns);
  BusBudget budget;
  budget.cyclic_bits_per_s = load.cyclic_bits_per_s;
  budget.other_bits_per_s = load.other_bits_per_s;
  budget.sdo_bits_per_s = load.sdo_bits_per_s;
  budget.load = load.total() / bus.bitrate_bps;
  int feedback_bits = 0, torque_bits = 0;
  for (const DriveSetup& drive : drives) {
    feedback_bits += FeedbackBits(drive.profile->pdos);
    torque_bits += can::WorstCaseBits(drive.profile->pdos.torque.bytes());
  }
  // Feedback yields only to a frame already on the bus.
  budget.feedback_ns = TimeOf(can::WorstCaseBits(0) + feedback_bits + can::WorstCaseBits(8), bus);
  budget.torques_ns = TimeOf(torque_bits, bus);
  while (budget.max_drives_at_this_cycle < 127 &&
         LoadOf(bus, pdos, budget.max_drives_at_this_cycle + 1, bus.cycle_ns).total() <= allowed) {
    ++budget.max_drives_at_this_cycle;
  }
  for (TimeNs cycle_ns = kNsPerMs; cycle_ns <= kLongestCycle_ns; cycle_ns += kNsPerMs) {
    if (LoadOf(bus, pdos, count, cycle_ns).total() <= allowed) {
      budget.min_cycle_ns_for_these_drives = cycle_ns;
      break;
    }
  }
  return budget;
}

std::string FeedbackDeadlineProblem(const BusParameters& bus, std::span<const DriveSetup> drives) {
  const BusBudget budget = ComputeBusBudget(bus, drives);
  const TimeNs latest_ns = bus.cycle_ns - budget.torques_ns;
  if (bus.feedback_deadline_ns >= budget.feedback_ns && bus.feedback_deadline_ns <= latest_ns) return "";
  const bool early = bus.feedback_deadline_ns < budget.feedback_ns;
  std::array<char, 320> text{};
  const int n = std::snprintf(
      text.data(), text.size(), "%lld is too %s: at %d bit/s the %s of %d drives can take %lld ns%s; ",
      static_cast<long long>(bus.feedback_deadline_ns), early ? "early" : "late", bus.bitrate_bps,
      early ? "feedback" : "torques", static_cast<int>(drives.size()),
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
