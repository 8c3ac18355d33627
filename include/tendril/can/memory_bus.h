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

  /// A new port; lives as long as the bus. An error frame sent on it reaches the others as on a virtual CAN
  /// interface: bus-off clears their up(), a restarted frame or their own Restart() sets it again. It holds
  /// 8192 unread frames and drops (and counts) further ones, as a socket does. It cannot wait: WaitUntil only
  /// returns whether a frame is there. One thread at a time uses a bus.
  CanPort& AddPort();

  /// Called with each frame before delivery; may change it, or return false to drop it. For fault injection
  /// and taps.
  using Filter = std::function<bool(CanFrame&)>;
  void SetFilter(Filter filter);

  /// true: puts a bus-off error frame into every port; until false (a restarted error frame) no port is up
  /// and nothing can be sent.
  void SetBusOff(bool off);

  /// Totals of the bus: `sent` and `bits` count each accepted frame once, including those that the filter
  /// dropped; `received` and `receive_dropped` are sums over the ports.
  const CanCounters& totals() const;

 private:
  class Port;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::can
