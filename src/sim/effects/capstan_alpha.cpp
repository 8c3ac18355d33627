// Effect: the friction coefficient of the guide pulleys differs.
#include "common.h"

namespace tendril::sim {

Effect CapstanAlpha() {
  return {
      .name = "capstan_alpha",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .element = Element::kPulleys,
      .number = "actuation.transmission.pulleys.alpha",
      .parameters = {Scale(0.1, 4, 0.2)},
      .summary = "the pulleys' friction coefficient differs from nominal",
      .physics =
          "In the improved Capstan equation the friction per length is alpha N^n; alpha is scale x nominal. "
          "Wear, dust, another tendon or a different lubricant change it. The ratio of the tensions on both "
          "sides grows with alpha in every direction of motion.",
      .signature =
          "Tension is lost between motor and robot in proportion to the tension, in a loop between "
          "pulling and paying out. Scale above 1: the robot receives less when pulled and keeps more "
          "when paid out. A cell between pulley and robot shows it against the torque, a cell at the "
          "motor only through the shape.",
      .experiment =
          "Slow reversals at three levels of co-contraction. The loop's height grows a little less than "
          "the tension (n < 1); with a cell on either side of the pulley it is measured directly.",
      .confusable = {"capstan_n", "wrap_angle", "routing_friction", "pulley_coulomb", "backbone_hysteresis"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target, [&](TendonDriveParameters& tendon) {
              for (PulleyParameters& pulley : tendon.transmission.pulleys) pulley.alpha *= v[0];
            });
          },
  };
}

}  // namespace tendril::sim
