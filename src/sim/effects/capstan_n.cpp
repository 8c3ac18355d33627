// Effect: the exponent of the pulleys' friction law differs.
#include <algorithm>

#include "common.h"

namespace tendril::sim {

Effect CapstanN() {
  return {
      .name = "capstan_n",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .element = Element::kPulleys,
      .number = "actuation.transmission.pulleys.exponent",
      .parameters = {Scale(0.5, 1.5, 0.1)},
      .summary = "the pulleys' friction grows with another power of the load than nominal",
      .physics =
          "In the improved Capstan equation the friction per length is alpha N^n; n is scale x nominal, "
          "at most 1 (dry metal 1, polymers and fibres less). With n < 1 the ratio of the tensions "
          "falls as the tension rises.",
      .signature =
          "The share of tension lost over the pulleys changes with the tension: scale above 1 makes it "
          "more even. At one tension alone it looks like another alpha.",
      .experiment =
          "Slow reversals at a low, a medium and a high level of co-contraction: the ratio of the "
          "tensions on both branches against the level.",
      .confusable = {"capstan_alpha", "wrap_angle", "pulley_coulomb"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target, [&](TendonDriveParameters& tendon) {
              for (PulleyParameters& pulley : tendon.transmission.pulleys)
                pulley.exponent = std::min(1.0, pulley.exponent * v[0]);
            });
          },
  };
}

}  // namespace tendril::sim
