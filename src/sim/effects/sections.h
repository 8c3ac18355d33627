// Helpers of effects on the body's sections and units: their targets. Knows no effect.
#pragma once

#include "common.h"

namespace tendril::sim {

/// Calls change(SectionParameters&) for the target's section, or for all of them.
template <class Change>
void ForSections(RobotParameters& robot, Target target, Change change) {
  ForTarget(robot.body.sections, target, change);
}

/// Calls change(TendonRoute&) for the target's tendon (counted over the sections), or for all of them.
template <class Change>
void ForRoutes(RobotParameters& robot, Target target, Change change) {
  int tendon = 0;
  for (SectionParameters& section : robot.body.sections) {
    for (TendonRoute& route : section.tendons) {
      if (!target || *target == tendon) change(route);
      ++tendon;
    }
  }
}

/// Calls change(UnitDeviation&) for the target's unit, or for all of them.
template <class Change>
void ForUnits(RobotParameters& robot, Target target, Change change) {
  for (int unit = 0; unit < robot.body.units(); ++unit) {
    if (!target || *target == unit) change(robot.body.DeviationOf(unit + 1));
  }
}

/// Viscous damping of a strain of this stiffness in the material that damps the section's bending: the same time
/// constant [s].
inline double DampingTime_s(const SectionParameters& s) { return s.bending_damping_Nms / s.UnitStiffness(); }

/// Units [first, end) of the target's section, or all.
struct UnitRange {
  int first = 0, end = 0;
};
inline UnitRange UnitsOf(const RobotParameters& robot, Target target) {
  if (!target) return {0, robot.body.units()};
  UnitRange range;
  for (int k = 0; k <= *target; ++k) {
    range.first = range.end;
    range.end += robot.body.sections[static_cast<std::size_t>(k)].units;
  }
  return range;
}

}  // namespace tendril::sim
