// A drive's position counts (0x6064): how far it moved, and the angle of its motor. Knows no sign and no
// zero.
#pragma once

#include <cstdint>
#include <numbers>

#include "tendril/core/robot.h"

namespace tendril {

/// now - before, across a wrap of the drive's position counter.
constexpr std::int32_t CountsMoved(std::int32_t now, std::int32_t before) noexcept {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(now) - static_cast<std::uint32_t>(before));
}

/// Angle of the motor shaft [rad] for a position, or a difference of positions, in counts.
inline double MotorAngle_rad(const DriveParameters& drive, double counts) {
  return counts * 2 * std::numbers::pi / drive.encoder_counts_per_turn;
}

}  // namespace tendril
