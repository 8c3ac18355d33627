// What the EPOS4 has beyond its profile: its maker's number, its own rated torque, its data sheet.
#pragma once

#include <cstdint>
#include <string>

namespace tendril::canopen {

inline constexpr std::uint32_t kMaxonVendorId = 0x000000FB;

/// 0x6076 [uNm] from a nominal current and a torque constant, as the drive computes it (rounded to nearest,
/// after parameter files of real drives).
constexpr std::uint32_t RatedTorque_uNm(std::uint32_t nominal_current_mA,
                                        std::uint32_t torque_constant_uNmpA) {
  return static_cast<std::uint32_t>(
      (static_cast<std::uint64_t>(nominal_current_mA) * torque_constant_uNmpA + 500u) / 1000u);
}

/// The EPOS4's object table as an electronic data sheet (CiA 306), for other CANopen tools.
std::string EdsText();

}  // namespace tendril::canopen
