// Conversion of a drive's counts to the tendon's side, and how long a live sensor may repeat one value.
// Shared by guards, take-up, estimator and feedback; contains no rule.
#pragma once

#include <cstdint>
#include <numbers>

#include "tendril/core/robot.h"

namespace tendril::control {

/// A live load cell's last digit, and a live drive's feedback, change within this many cycles.
inline constexpr std::int32_t kRestingCycles = 200;

/// now - before, across a wrap of the drive's position counter.
constexpr std::int32_t CountsMoved(std::int32_t now, std::int32_t before) noexcept {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(now) - static_cast<std::uint32_t>(before));
}

inline double RadPerCount(const TendonDriveParameters& t) {
  return 2 * std::numbers::pi / t.drive.encoder_counts_per_turn;
}

/// Tendon travel per count [m].
inline double TravelPerCount(const TendonDriveParameters& t) {
  return RadPerCount(t) * t.SpoolTravelPerMotorRad();
}

/// The motor's Coulomb friction [N] at the spool.
inline double FrictionAtSpool(const TendonDriveParameters& t) {
  return t.motor.coulomb_friction_Nm / t.SpoolTravelPerMotorRad();
}

}  // namespace tendril::control
