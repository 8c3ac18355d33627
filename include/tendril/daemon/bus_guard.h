// One master a bus: keeps a second daemon off the same interface, and notices a master that is none of ours.
// Knows nothing of what the daemon does with the bus.
#pragma once

#include <string>

#include "tendril/can/can_port.h"
#include "tendril/core/clock.h"

namespace tendril::daemon {

/// Held by the daemon on an interface for as long as it lives. Like the interface's name it is valid within
/// one network namespace, and nothing is left behind when the process dies.
class BusGuard {
 public:
  /// Throws std::runtime_error naming the interface and the other daemon's process id when there is one.
  explicit BusGuard(const std::string& interface);
  ~BusGuard();
  BusGuard(const BusGuard&) = delete;
  BusGuard& operator=(const BusGuard&) = delete;

 private:
  int socket_;
};

/// Listens for `listen_ns`; throws std::runtime_error when somebody else sends SYNC (identifier 0x080) on
/// this bus.
void RefuseForeignSync(can::CanPort& port, const Clock& clock, const std::string& interface,
                       TimeNs listen_ns);

}  // namespace tendril::daemon
