#include "tendril/core/clock.h"

#include <ctime>

namespace tendril {

TimeNs MonotonicClock::Now() const noexcept {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<TimeNs>(t.tv_sec) * kNsPerS + t.tv_nsec;
}

}  // namespace tendril
