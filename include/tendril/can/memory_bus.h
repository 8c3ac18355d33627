// A CAN bus in memory: every frame sent on one port reaches all others in order, stamped by a given clock.
// Deterministic; for closed loops in simulated time and for tests.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "tendril/can/can_port.h"

namespace tendril::can {

class MemoryBus {
 public:
  /// `clock` stamps the frames and must outlive the bus.
  explicit MemoryBus(const Clock& clock);
  ~MemoryBus();

  /// A new port; lives as long as the bus.
  CanPort& AddPort();

  /// Sees each frame before delivery and may change it; return false to drop it. For fault injection and taps.
  using Filter = std::function<bool(CanFrame&)>;
  void SetFilter(Filter filter);

  /// Puts an error frame into every port (for example bus-off) or clears the condition again.
  void SetBusOff(bool off);

  /// Frames and worst-case bits of everything ever sent on the bus.
  const CanCounters& totals() const;

 private:
  class Port;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::can
