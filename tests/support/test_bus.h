// Parameters of a bus of identical drives, as a master gets them. Test use only.
#pragma once

#include <cstdint>
#include <vector>

#include "tendril/canopen/master.h"

namespace tendril::canopen {

inline constexpr std::uint32_t kCurrent_mA = 360, kConstant_uNmpA = 19600, kRated_uNm = 7056;

inline BusParameters TestBus(int drives, TimeNs cycle_ns = kNsPerMs) {
  BusParameters bus;
  bus.interface = "memory";
  bus.bitrate_bps = 1'000'000;
  bus.cycle_ns = cycle_ns;
  bus.feedback_deadline_ns = cycle_ns * 3 / 5;
  bus.heartbeat_ms = 100;
  bus.heartbeat_timeout_ms = 250;
  bus.sdo_timeout_ms = 50;
  bus.boot_timeout_ms = 3000;
  bus.abort_connection_option = 2;
  bus.max_load = 0.8;
  bus.identity = {.vendor_id = 0xFB,
                  .product_codes = {0x61500000, 0x60500000},
                  .min_revision = 0x01000000,
                  .max_revision = 0x01FFFFFF};
  for (int i = 1; i <= drives; ++i) bus.nodes.push_back({i, i});
  return bus;
}

inline std::vector<DriveSetup> TestDrives(int drives) {
  std::vector<DriveSetup> setups;
  for (int i = 1; i <= drives; ++i)
    setups.push_back({i, kCurrent_mA, 2 * kCurrent_mA, kConstant_uNmpA, kRated_uNm});
  return setups;
}

}  // namespace tendril::canopen
