// Listens for SYNC before the daemon sends its own.
// Knows nothing of what the daemon does with the bus.
#include "tendril/daemon/foreign_sync.h"

#include <algorithm>
#include <array>
#include <span>
#include <stdexcept>

#include "tendril/canopen/wire.h"

namespace tendril::daemon {

void RefuseForeignSync(can::CanPort& port, const Clock& clock, const std::string& interface,
                       TimeNs listen_ns) {
  const TimeNs end_ns = clock.Now() + listen_ns;
  std::array<can::StampedFrame, 64> frames;
  while (clock.Now() < end_ns) {
    port.WaitUntil(end_ns);
    const auto count = static_cast<std::size_t>(std::max(port.Receive(frames), 0));
    for (const can::StampedFrame& f : std::span(frames).first(count)) {
      if (canopen::IsSync(f.frame)) {
        throw std::runtime_error("another CANopen master sends SYNC on " + interface +
                                 "; stop it first: a bus has one master");
      }
    }
  }
}

}  // namespace tendril::daemon
