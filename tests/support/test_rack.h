// Emulated drives on the bus of test_bus.h: the set-up of tests that only vary what goes between them. Test
// use only.
#pragma once

#include <vector>

#include "support/test_bus.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {

inline constexpr int kDrives = 3;
inline constexpr double kRated_Nm = 7056e-6;  // 360 mA x 19600 uNm/A, by hand

inline std::vector<EmulatedDriveParameters> TestRack(int drives) {
  std::vector<EmulatedDriveParameters> rack;
  for (int i = 1; i <= drives; ++i) {
    rack.push_back({.node_id = i,
                    .nominal_current_mA = canopen::kCurrent_mA,
                    .torque_constant_uNmpA = canopen::kConstant_uNmpA});
  }
  return rack;
}

}  // namespace tendril::emulator
