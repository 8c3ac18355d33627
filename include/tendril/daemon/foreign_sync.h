// Detects another CANopen master before this one sends. Knows nothing of what the daemon does with the bus.
#pragma once

#include <string>

#include "tendril/can/can_port.h"
#include "tendril/core/clock.h"

namespace tendril::daemon {

/// Listens for `listen_ns`; throws std::runtime_error when another master sends SYNC (identifier 0x080) on
/// this bus.
void RefuseForeignSync(can::CanPort& port, const Clock& clock, const std::string& interface,
                       TimeNs listen_ns);

}  // namespace tendril::daemon
