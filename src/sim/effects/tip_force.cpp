// Effect: a constant force at the tip.
#include "common.h"

namespace tendril::sim {

Effect TipForce() {
  const EffectParameter x{
      .name = "x_N", .nominal = 0, .lower = -1, .upper = 1, .typical = 0.03, .of = Yardstick::kTipForce};
  EffectParameter y = x, z = x;
  y.name = "y_N";
  z.name = "z_N";
  return {
      .name = "tip_force",
      .stage = Stage::kBody,
      .scope = Scope::kRobot,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .parameters = {x, y, z},
      .summary = "a steady force on the tip: a taut lead, a hose, a spring, the environment",
      .physics =
          "A force constant in size and direction in the base frame acts at the centre of the last disk. It "
          "has no inertia, and its moment about each unit changes with the shape.",
      .signature =
          "An offset of the tip towards one fixed side that is smaller where the robot is stiff (high "
          "tension) and does not turn when the base is rolled; frequencies stay as they are. Along the "
          "backbone a pull mainly stiffens it and a push softens it.",
      .experiment =
          "Bends in every direction at two co-contractions; take off whatever hangs at the tip and repeat "
          "one of them.",
      .confusable = {"precurvature", "base_tilt", "tip_payload", "tracker_offset", "bending_stiffness",
                     "unit_stiffness"},
      .edit =
          [](RobotParameters& robot, Target, std::span<const double> v) {
            robot.body.tip_force_W_N += Eigen::Vector3d(v[0], v[1], v[2]);
          },
  };
}

}  // namespace tendril::sim
