#include "tendril/rt/paced_time.h"

#include <chrono>
#include <thread>

namespace tendril::rt {
namespace {

// Delays up to this are made up for by the next cycles; longer ones slip.
constexpr TimeNs kMadeUp_ns = 20 * kNsPerMs;

TimeNs SinceEpoch() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

PacedTime::PacedTime(double speed) : clock_(SinceEpoch()), speed_(speed) {}

void PacedTime::Run(TimeNs period_ns, const std::function<bool(const CycleStart&)>& body) {
  const MonotonicClock machine;
  const auto pace_ns = static_cast<TimeNs>(static_cast<double>(period_ns) / speed_);
  TimeNs due_ns = machine.Now();
  for (std::uint64_t cycle = 0;; ++cycle) {
    clock_.Advance(period_ns);
    if (!body({.cycle = cycle, .grid_ns = clock_.Now(), .wake_latency_ns = 0, .missed = 0})) return;
    if (after_each_) after_each_();
    due_ns += pace_ns;
    const TimeNs late_ns = machine.Now() - due_ns;
    if (late_ns > kMadeUp_ns) {
      due_ns += late_ns;
      slipped_ns_.fetch_add(late_ns, std::memory_order_relaxed);
    } else if (late_ns < 0) {
      std::this_thread::sleep_for(std::chrono::nanoseconds(-late_ns));
    }
  }
}

}  // namespace tendril::rt
