// What the cycles were like: latencies, missed cycles and their causes, drives, bus. Knows nothing of where
// it is published.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "handover.h"
#include "tendril/canopen/master.h"
#include "tendril/core/cycle.h"
#include "tendril/core/statistics.h"
#include "tendril/io/gateway.h"
#include "tendril/rt/cyclic.h"
#include "tendril/rt/usage.h"

namespace tendril::daemon {

class LoopReport {
 public:
  /// `setups` are those of `actuation` and must outlive it.
  LoopReport(const std::vector<canopen::DriveSetup>& setups, const ActuationParameters& actuation,
             double bitrate_bps)
      : setups_(setups), driven_(actuation.DrivenTendons()), bitrate_bps_(bitrate_bps) {}

  void Count(const Published& cycle);
  void Fault(const LastFault& fault) { statistics_.last_fault = fault; }

  std::uint64_t cycles() const { return wake_latency_.count(); }
  std::uint64_t deadline_misses() const { return last_timing_.deadline_misses; }

  /// Up to now; the drives' worst ages begin again.
  LoopStatistics Collect(TimeNs now_ns, const io::Gateway::Counters& lcm);
  /// Of the latencies, for the log.
  std::string LatencyText() const;
  /// For the log, where cycles were missed since the last call.
  std::optional<std::string> NewMisses();

 private:
  const std::vector<canopen::DriveSetup>& setups_;
  std::vector<int> driven_;  // tendons, by drive
  double bitrate_bps_;
  rt::Histogram wake_latency_, round_trip_, compute_, total_;
  LoopStatistics statistics_;
  std::deque<MissedCycles> misses_;
  MissedCycles worst_miss_;  // since the last report
  std::uint64_t misses_told_ = 0;
  can::CanCounters can_;
  canopen::FrameFaults frame_faults_;
  std::uint64_t reported_bits_ = 0;
  rt::ThreadUsage last_usage_;
  CycleTiming last_timing_;
};

}  // namespace tendril::daemon
