// Conversion of a drive's counts to the tendon's side, and how long a live sensor may repeat one value.
// Shared by guards, take-up, estimator and feedback; contains no rule.
#pragma once

#include <cstdint>

#include "tendril/core/drive_counts.h"
#include "tendril/core/robot.h"

namespace tendril::control {

/// A live load cell's last digit, and a live drive's feedback, change within this many cycles.
inline constexpr std::int32_t kRestingCycles = 200;

inline double RadPerCount(const TendonDriveParameters& t) { return MotorAngle_rad(t.drive, 1); }

/// Tendon travel per count [m].
inline double TravelPerCount(const TendonDriveParameters& t) {
  return RadPerCount(t) * t.SpoolTravelPerMotorRad();
}

/// The motor's Coulomb friction [N] at the spool.
inline double FrictionAtSpool(const TendonDriveParameters& t) {
  return t.motor.coulomb_friction_Nm / t.SpoolTravelPerMotorRad();
}

}  // namespace tendril::control
