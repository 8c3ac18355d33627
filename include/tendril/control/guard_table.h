// The guards as a table for people: what each watches, its thresholds, its status and how soon it acts. The rules
// themselves are in guards.cpp, controller.cpp and the bus master. Computes nothing.
#pragma once

#include <span>
#include <string_view>

#include "tendril/core/status.h"

namespace tendril::control {

/// When a guard judges.
enum class Watch {
  kAlways,
  kPowered,    // motors pull
  kTrusted,    // motors pull and load cells are known to work: not while commissioning or homing
  kTensioned,  // pretension is reached and displacement zeroed
  kFollowing,  // the robot follows the reference
  kTakeUp,     // commissioning or homing
};
std::string_view WatchText(Watch watch) noexcept;

struct GuardEntry {
  std::string_view what;      // is wrong, as a clause
  std::string_view keys;      // of the thresholds, in the daemon or robot file, separated by blanks; empty: none
  Status status{};            // what comes of it
  Watch watch{};
  std::string_view reaction;  // how long what is wrong lasts before the guard acts
};

std::span<const GuardEntry> GuardTable() noexcept;

}  // namespace tendril::control
