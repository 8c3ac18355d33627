// Helpers of most effects: target and parameter descriptions. Knows no effect.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "../laws.h"
#include "tendril/sim/effects.h"

namespace tendril::sim {

/// A factor on a number of the robot file.
inline EffectParameter Scale(double lower, double upper, double typical, std::vector<double> starts = {}) {
  return {.name = "scale",
          .nominal = 1,
          .lower = lower,
          .upper = upper,
          .typical = typical,
          .starts = std::move(starts)};
}

/// Calls change(item) for the target's item, or for all of them.
template <class Items, class Change>
void ForTarget(Items& items, Target target, Change change) {
  if (target) return change(items[static_cast<std::size_t>(*target)]);
  for (auto& item : items) change(item);
}

/// Calls change(TendonDriveParameters&) for the target's tendon, or for all of them.
template <class Change>
void ForTendons(RobotParameters& robot, Target target, Change change) {
  if (robot.actuation) ForTarget(robot.actuation->tendons, target, change);
}

}  // namespace tendril::sim
