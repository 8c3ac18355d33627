// What passes between the daemon's real-time thread and the one that serves LCM, without locks.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "tendril/can/can_port.h"
#include "tendril/canopen/master.h"
#include "tendril/core/cycle.h"
#include "tendril/rt/handoff.h"
#include "tendril/rt/usage.h"

namespace tendril::daemon {

/// A cycle, for the serving thread.
struct Published {
  CycleRecord record;
  can::CanCounters can;
  canopen::FrameFaults frame_faults;
  rt::ThreadUsage usage;  // cumulative
  std::array<std::uint32_t, kMaxTendons> serials{};
};

struct Handover {
  /// Before the first cycle nothing consumes commands.
  bool ticks() const { return tick.load(std::memory_order_relaxed) > 0; }

  rt::Handoff<Command> commands{256}, stops{16};
  rt::Handoff<TrackerSample> tracker{64};
  rt::Handoff<Published> records{1024};  // a second at 1 kHz
  rt::Handoff<canopen::BusEvent> events{256};
  std::atomic<bool> stop_requested{false}, finished{false}, disarmed_in_time{true};
  std::atomic<bool> disarm_waits{false};  // a disarm that did not fit into the queue
  std::atomic<std::uint64_t> tick{0}, master_events_lost{0}, overtaken{0};
  std::atomic<TimeNs> served_ns{0};
};

}  // namespace tendril::daemon
