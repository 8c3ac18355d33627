// What the bus budget counts and the master observes. Knows frame lengths, nothing of drives' states.
#pragma once

#include "tendril/can/can_port.h"
#include "tendril/canopen/drive_profile.h"

namespace tendril::canopen {

/// Bits of what one drive sends after a SYNC.
constexpr int FeedbackBits(const DrivePdos& pdos) {
  return can::WorstCaseBits(pdos.feedback.bytes()) +
         (pdos.status.transmission == 1 ? can::WorstCaseBits(pdos.status.bytes()) : 0);
}
/// PDO bits of one drive per cycle.
constexpr int PdoBits(const DrivePdos& pdos) {
  return can::WorstCaseBits(pdos.torque.bytes()) + FeedbackBits(pdos);
}
/// Bits of one SDO request and its response.
inline constexpr int kSdoExchangeBits = 2 * can::WorstCaseBits(8);
/// The budget reserves one SDO exchange per this many cycles.
inline constexpr int kCyclesPerSdoExchange = 20;

}  // namespace tendril::canopen
