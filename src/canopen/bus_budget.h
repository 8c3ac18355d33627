// What the master keeps to on the bus, so that the budget holds.
// Knows frames' lengths, nothing of drives' states.
#pragma once

#include "tendril/can/can_port.h"
#include "tendril/canopen/pdo.h"

namespace tendril::canopen {

/// Of one drive each cycle.
inline constexpr int kPdoBits =
    can::WorstCaseBits(kRpdoTorque.bytes()) + can::WorstCaseBits(kTpdoFeedback.bytes());
/// Of one SDO request and its response.
inline constexpr int kSdoExchangeBits = 2 * can::WorstCaseBits(8);
/// The budget keeps room for one exchange in so many cycles.
inline constexpr int kCyclesPerSdoExchange = 20;

}  // namespace tendril::canopen
