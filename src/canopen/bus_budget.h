// Constants of the bus budget that the master observes. Knows frame lengths, nothing of drives' states.
#pragma once

#include "tendril/can/can_port.h"
#include "tendril/canopen/pdo.h"

namespace tendril::canopen {

/// PDO bits of one drive per cycle.
inline constexpr int kPdoBits =
    can::WorstCaseBits(kRpdoTorque.bytes()) + can::WorstCaseBits(kTpdoFeedback.bytes());
/// Bits of one SDO request and its response.
inline constexpr int kSdoExchangeBits = 2 * can::WorstCaseBits(8);
/// The budget reserves one SDO exchange per this many cycles.
inline constexpr int kCyclesPerSdoExchange = 20;

}  // namespace tendril::canopen
