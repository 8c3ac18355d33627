// Time as signed nanoseconds, and the one interface through which anything above rt/ may ask for it.
#pragma once

#include <cstdint>

namespace tendril {

/// Nanoseconds of a monotonic clock whose zero has no meaning. Signed, so that differences are safe.
using TimeNs = std::int64_t;

inline constexpr TimeNs kNsPerUs = 1'000;
inline constexpr TimeNs kNsPerMs = 1'000'000;
inline constexpr TimeNs kNsPerS = 1'000'000'000;

inline constexpr double ToSeconds(TimeNs t_ns) { return static_cast<double>(t_ns) * 1e-9; }

class Clock {
 public:
  virtual ~Clock() = default;
  virtual TimeNs Now() const noexcept = 0;
};

/// CLOCK_MONOTONIC of this machine.
class MonotonicClock final : public Clock {
 public:
  TimeNs Now() const noexcept override;
};

/// A clock that moves only by calls: closed-loop tests and the demo run on it.
class SimulatedClock final : public Clock {
 public:
  explicit SimulatedClock(TimeNs start_ns = 0) : now_ns_(start_ns) {}
  TimeNs Now() const noexcept override { return now_ns_; }
  void Advance(TimeNs by_ns) noexcept { now_ns_ += by_ns; }

 private:
  TimeNs now_ns_;
};

}  // namespace tendril
