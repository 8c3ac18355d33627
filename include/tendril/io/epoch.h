// This machine's wall clock, as messages are stamped (utime). Knows nothing of the robot's time.
#pragma once

#include <chrono>
#include <cstdint>

namespace tendril::io {

/// Microseconds since the epoch.
inline std::int64_t EpochUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace tendril::io
