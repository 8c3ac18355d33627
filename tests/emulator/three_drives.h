// Three drives and the bus that their master is told: the set-up of tests that only vary what goes between
// them. Test use only.
#pragma once

#include <cstdint>
#include <vector>

#include "tendril/canopen/master.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {

inline constexpr int kDrives = 3;
inline constexpr std::uint32_t kCurrent_mA = 360, kConstant_uNmpA = 19600, kRated_uNm = 7056;

inline BusParameters Bus() {
  BusParameters bus;
  bus.bitrate_bps = 1'000'000;
  bus.cycle_ns = kNsPerMs;
  bus.feedback_deadline_ns = 600'000;
  bus.heartbeat_ms = 100;
  bus.heartbeat_timeout_ms = 250;
  bus.sdo_timeout_ms = 50;
  bus.boot_timeout_ms = 3000;
  bus.abort_connection_option = 2;
  bus.max_load = 0.8;
  bus.identity = {.vendor_id = 0xFB,
                  .product_codes = {0x60500000},
                  .min_revision = 0x01000000,
                  .max_revision = 0x01FFFFFF};
  for (int i = 1; i <= kDrives; ++i) bus.nodes.push_back({i, i});
  return bus;
}

inline std::vector<EmulatedDriveParameters> Drives() {
  std::vector<EmulatedDriveParameters> drives;
  for (int i = 1; i <= kDrives; ++i) {
    drives.push_back(
        {.node_id = i, .nominal_current_mA = kCurrent_mA, .torque_constant_uNmpA = kConstant_uNmpA});
  }
  return drives;
}

inline std::vector<canopen::DriveSetup> Setups() {
  std::vector<canopen::DriveSetup> setups;
  for (int i = 1; i <= kDrives; ++i) {
    setups.push_back({i, kCurrent_mA, 2 * kCurrent_mA, kConstant_uNmpA, kRated_uNm});
  }
  return setups;
}

}  // namespace tendril::emulator
