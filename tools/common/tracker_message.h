// A tracker's reading as the message of its channel. Knows nothing of rigs and connections.
#pragma once

#include <tendril_lcm/tracker_t.hpp>

#include "tendril/core/cycle.h"

namespace tendril::tools {

/// `utime`: microseconds since the epoch (in simulation: simulated time) of the measurement.
inline tendril_lcm::tracker_t TrackerMessage(const TrackerSample& sample, std::int64_t utime) {
  tendril_lcm::tracker_t message{};
  message.utime = utime;
  message.valid = sample.valid;
  for (int i = 0; i < 3; ++i) message.tip_W_m[i] = sample.tip_W_m[i];
  message.orientation_WT[0] = sample.orientation_WT.w();
  message.orientation_WT[1] = sample.orientation_WT.x();
  message.orientation_WT[2] = sample.orientation_WT.y();
  message.orientation_WT[3] = sample.orientation_WT.z();
  return message;
}

}  // namespace tendril::tools
