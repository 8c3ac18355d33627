// Effect: pulley friction independent of the load.
#include "common.h"

namespace tendril::sim {

Effect PulleyCoulomb() {
  return {
      .name = "pulley_coulomb",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .parameters =
          {{.name = "N", .nominal = 0, .lower = 0, .upper = 2, .typical = 0.1, .of = Yardstick::kTension}},
      .summary = "the pulleys reduce the tension by a constant amount at any load",
      .physics =
          "Bearings, seals and guides resist with a constant force: on the robot's side N less when the "
          "motor pulls, N more when it pays out, with the pre-sliding of the pulleys. It fades below the "
          "tension at which the friction law is continued, since a slack tendon turns no pulley.",
      .signature =
          "A loop of the tensions on both sides with constant height: it does not shrink with the "
          "tension, while Capstan friction does.",
      .experiment =
          "Slow reversals at three levels of co-contraction: height of the loop against the level; the "
          "height left at level zero is this effect.",
      .confusable = {"capstan_alpha", "capstan_n", "motor_coulomb", "routing_friction",
                     "backbone_hysteresis"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.transmission.coulomb_N += v[0]; });
          },
  };
}

}  // namespace tendril::sim
