// Effect: a payload at the tip.
#include "common.h"

namespace tendril::sim {

Effect TipPayload() {
  return {
      .name = "tip_payload",
      .stage = Stage::kBody,
      .scope = Scope::kRobot,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .parameters = {{.name = "mass_kg",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 0.1,
                      .typical = 0.003,
                      .of = Yardstick::kTipMass}},
      .summary = "a mass at the tip: tool, camera, tracker markers, a gripped part",
      .physics =
          "A point mass m at the centre of the last disk: weight m g at the full length of the robot, and "
          "inertia there. An upright robot under it is also nearer to buckling, as if it were softer.",
      .signature =
          "A bent robot hangs lower (upright: bends further) in the direction of gravity, more so the "
          "farther out the tip is; frequencies fall, the lowest one most.",
      .experiment =
          "Bends in several planes with the base tilted or turned over: only weight changes sign with it. "
          "Hanging a known mass to the tip calibrates the answer.",
      .confusable = {"unit_mass", "bending_stiffness", "tip_force", "base_tilt"},
      .edit = [](RobotParameters& robot, Target,
                 std::span<const double> v) { robot.body.tip_payload_kg += v[0]; },
  };
}

}  // namespace tendril::sim
