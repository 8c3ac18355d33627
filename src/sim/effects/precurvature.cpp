// Effect: the backbone is bent without load.
#include "sections.h"

namespace tendril::sim {

Effect Precurvature() {
  const EffectParameter along_x{.name = "u_rad",
                                .nominal = 0,
                                .lower = -0.5,
                                .upper = 0.5,
                                .typical = 0.03,
                                .of = Yardstick::kUnitBend};
  EffectParameter along_y = along_x;
  along_y.name = "v_rad";
  return {
      .name = "precurvature",
      .stage = Stage::kBody,
      .scope = Scope::kUnit,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .parameters = {along_x, along_y},
      .summary = "the unloaded backbone is bent: wire set, assembly, creep of an overload",
      .physics =
          "A unit is free of stress at the bend (u, v) = (u_rad, v_rad) instead of straight; its moment is "
          "(EI / l) times the bend from there. `all` gives every unit the same rest bend: the set of a wire "
          "from a spool.",
      .signature =
          "The tip is off to one fixed side, most where tensions are low and equal, and the tensions needed "
          "for opposite bends differ by a constant. The offset turns with the robot when it is rolled; "
          "gravity's does not.",
      .experiment =
          "Equal tensions at several levels, or the sway at zero tension, with the base rolled by half a "
          "turn: what turns with the base is rest shape, what stays with the room is weight, tilt or a "
          "pulling cable.",
      .confusable = {"base_tilt", "tip_force", "tracker_rotation", "tracker_offset", "cell_offset"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForUnits(robot, target, [&](UnitDeviation& unit) {
              unit.rest_u_rad += v[0];
              unit.rest_v_rad += v[1];
            });
          },
  };
}

}  // namespace tendril::sim
