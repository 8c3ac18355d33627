// The real-time loop: an absolute deadline grid on CLOCK_MONOTONIC, missed periods counted and skipped whole,
// phase never reset. Knows nothing of what runs in it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "tendril/core/clock.h"
#include "tendril/core/daemon.h"
#include "tendril/core/statistics.h"

namespace tendril::rt {

/// Locks the process's memory, prefaults the calling thread's stack and the program's code, sets its priority
/// and affinity, and with a priority disables deep CPU sleep until the process ends. Returns an empty text,
/// or what failed and which limit to raise; the other steps are done nevertheless.
std::string EnterRealtime(const RealtimeParameters& parameters);

/// Grid arithmetic, separate from any clock so that it can be tested.
class DeadlineGrid {
 public:
  DeadlineGrid(TimeNs start_ns, TimeNs period_ns) : next_ns_(start_ns), period_ns_(period_ns) {}
  TimeNs next_ns() const noexcept { return next_ns_; }
  /// Advances from the grid point just served to the next one not before `now_ns`; returns the number of grid
  /// points in between: periods missed and skipped whole (0 when on time).
  std::uint64_t Advance(TimeNs now_ns) noexcept;

 private:
  TimeNs next_ns_, period_ns_;
};

struct CycleStart {
  std::uint64_t cycle = 0;
  TimeNs grid_ns = 0;          // the point on the grid
  TimeNs wake_latency_ns = 0;  // how late the thread woke
  std::uint64_t missed = 0;    // periods skipped just before this cycle
};

/// Calls body(start) once per period, counted from now, until it returns false. A late wake-up runs at once;
/// the periods missed by it are skipped whole.
void RunCyclic(TimeNs period_ns, const std::function<bool(const CycleStart&)>& body);

/// What a control loop takes its time from: this machine, or simulated time that a program paces itself.
class Timebase {
 public:
  virtual ~Timebase() = default;
  virtual const Clock& clock() const noexcept = 0;
  /// As EnterRealtime.
  virtual std::string Enter(const RealtimeParameters& parameters) = 0;
  /// As RunCyclic, on this timebase's clock.
  virtual void Run(TimeNs period_ns, const std::function<bool(const CycleStart&)>& body) = 0;
};

/// CLOCK_MONOTONIC, EnterRealtime and RunCyclic.
Timebase& RealTime();

/// Counts of a latency in logarithmic bins, eight per octave, up to 17 s; Add is wait-free and
/// allocation-free. Negative values count as zero.
class Histogram {
 public:
  void Add(TimeNs value_ns) noexcept;
  std::uint64_t count() const noexcept { return count_; }
  TimeNs max_ns() const noexcept { return max_ns_; }
  /// The value not exceeded by at least the given share (0..1) of the values, at most 1/8 above the exact
  /// one; 0 when empty.
  TimeNs Percentile(double share) const noexcept;
  LatencyStatistics Statistics() const noexcept;

 private:
  static constexpr int kBins = 32 * 8;
  std::uint64_t bin_[kBins]{};
  std::uint64_t count_ = 0;
  TimeNs max_ns_ = 0;
};

}  // namespace tendril::rt
