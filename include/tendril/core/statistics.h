// How the loop goes, as data: latencies, misses with their cause, the bus, the drives and what the kernel did
// to the thread. Collected by the daemon, published by the gateway once a second. Plain values.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "tendril/core/clock.h"
#include "tendril/core/cycle.h"

namespace tendril {

/// Bins of published histograms: values below 2^10 ns (1 us), below 2^11 ns, ... , below 2^30 ns (1 s), and
/// the rest.
inline constexpr int kLatencyBins = 22;
constexpr TimeNs LatencyBinBelow_ns(int bin) {
  return bin + 1 < kLatencyBins ? TimeNs{1} << (10 + bin) : INT64_MAX;
}

struct LatencyStatistics {
  TimeNs median_ns = 0, p99_ns = 0, p999_ns = 0, max_ns = 0;
  std::array<std::uint64_t, kLatencyBins> counts{};
};

/// Whole periods that were skipped, and what took their time.
struct MissedCycles {
  std::uint64_t cycle = 0;    // the one that came late
  std::uint64_t skipped = 0;  // periods before it
  std::string cause;
};

struct DriveStatistics {
  int node_id = 0;
  DriveState state = DriveState::kOffline;
  std::uint16_t statusword = 0, error_code = 0;  // as in DriveFeedback
  std::uint32_t serial = 0;                      // 0x1018:04; 0: not read yet
  int age_cycles = 0;        // of its feedback; 0: arrived in the last cycle
  int worst_age_cycles = 0;  // since the last report
};

/// The last change to mode fault.
struct LastFault {
  std::int64_t utime = 0;  // [us since the epoch]; 0: none since start
  Status status = Status::kOk;
  std::string text;  // with tendon and node where one is to blame
};

/// All counts since start unless said otherwise.
struct LoopStatistics {
  TimeNs time_ns = 0;
  std::uint64_t cycles = 0, deadline_misses = 0;
  LatencyStatistics wake_latency, compute, round_trip;
  std::vector<MissedCycles> misses;  // the last few
  std::vector<DriveStatistics> drives;
  std::uint64_t can_sent = 0, can_received = 0, can_send_refused = 0, can_receive_dropped = 0,
                can_error_frames = 0, can_bus_off = 0, can_malformed = 0, can_foreign = 0;
  LastFault last_fault;
  std::uint64_t messages_ignored = 0, publish_failed = 0;  // LCM: not understood; not sent
  double bus_load = 0;  // of the bit rate, since the last report, worst-case stuffing
  // Of the real-time thread, within its cycles. What a cycle waits for on the bus is not counted.
  std::uint64_t voluntary_switches = 0;              // the thread waited: should be 0
  std::uint64_t involuntary_switches = 0;            // a thread of higher priority took its CPU
  std::uint64_t minor_faults = 0, major_faults = 0;  // pages were fetched: should be 0
};

}  // namespace tendril
