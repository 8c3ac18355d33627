// Effect: one unit of the backbone is softer or stiffer than the others.
#include "sections.h"

namespace tendril::sim {

Effect UnitStiffness() {
  return {
      .name = "unit_stiffness",
      .stage = Stage::kBody,
      .scope = Scope::kUnit,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = false,
      .on_one = true,
      .parameters = {Scale(0.3, 3, 0.2)},
      .summary = "one unit's bending stiffness differs from that of the others",
      .physics =
          "Unit i resists bending with scale x EI / l: a kink, a worn spot, a joint or a glued sleeve. The "
          "tendons' moment is nearly the same in every unit, so a soft unit bends more by itself and turns "
          "all that lies beyond it.",
      .signature =
          "The tip's position and its orientation do not match those of a uniform arc: a soft unit near the "
          "base moves the tip far with little change of orientation, one near the tip turns it without "
          "moving it. No loop, every direction alike.",
      .experiment =
          "Slow bends in several planes with position and orientation of the tip tracked, or a camera on the "
          "disks; the ratio of tip displacement to tip angle identifies the unit.",
      .confusable = {"bending_stiffness", "unit_length", "contact"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForUnits(robot, target, [&](UnitDeviation& unit) { unit.stiffness_scale *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
