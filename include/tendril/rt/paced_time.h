// Simulated time at the pace of the machine's clock. A late cycle runs late and none is skipped: where a
// real-time loop would miss cycles, simulated time falls behind.
#pragma once

#include <atomic>
#include <functional>
#include <utility>

#include "tendril/rt/cyclic.h"

namespace tendril::rt {

class PacedTime final : public Timebase {
 public:
  /// Passes `speed` times as fast as the machine's clock, from the present time since the epoch on.
  explicit PacedTime(double speed);

  const Clock& clock() const noexcept override { return clock_; }
  std::string Enter(const RealtimeParameters&) override { return {}; }
  void Run(TimeNs period_ns, const std::function<bool(const CycleStart&)>& body) override;

  /// Called at the end of each cycle, on the loop's thread.
  void AfterEachCycle(std::function<void()> what) { after_each_ = std::move(what); }

  /// Time of the machine by which this one has fallen behind for good [s]; from any thread.
  double slipped_s() const noexcept { return ToSeconds(slipped_ns_.load(std::memory_order_relaxed)); }

 private:
  class SharedClock final : public Clock {
   public:
    explicit SharedClock(TimeNs start_ns) : now_ns_(start_ns) {}
    TimeNs Now() const noexcept override { return now_ns_.load(std::memory_order_relaxed); }
    void Advance(TimeNs by_ns) noexcept { now_ns_.fetch_add(by_ns, std::memory_order_relaxed); }

   private:
    std::atomic<TimeNs> now_ns_;
  };

  SharedClock clock_;
  double speed_;
  std::function<void()> after_each_;
  std::atomic<TimeNs> slipped_ns_{0};
};

}  // namespace tendril::rt
