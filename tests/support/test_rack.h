// Emulated drives on the bus of test_bus.h: the set-up of tests that only vary what goes between them. Test
// use only.
#pragma once

#include <vector>

#include "support/test_bus.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {

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
