// Effect: the zero of the motor angle is not that of the straight robot at pretension.
#include "common.h"

namespace tendril::sim {

Effect EncoderOffset() {
  return {
      .name = "encoder_offset",
      .stage = Stage::kSensor,
      .scope = Scope::kTendon,
      .cut = Cut::kTendon,
      .cut_robot_side = Cut::kTendon,
      .on_one = true,
      .zero = true,
      // With a large offset to one side the model's tendon is slack and insensitive, so a start there is
      // tried as well.
      .parameters = {{.name = "rad",
                      .nominal = 0,
                      .lower = -10,
                      .upper = 10,
                      .typical = 0.05,
                      .starts = {-0.4, 0.4},
                      .of = Yardstick::kMotorTravel}},
      .summary = "the motor's reported angle is off by a constant",
      .physics =
          "Reported angle = angle + rad: the zero was taken with the robot bent, or with another pretension. "
          "A program that sets its zero at the start of each run removes it.",
      .signature =
          "Throughout a run the reported displacement is ahead of tension and shape by the same length "
          "(positive: reported ahead), from the first sample on and without any slack at the start.",
      .experiment = "Set the zero again on the straight robot at pretension, and compare.",
      .confusable = {"slack", "backlash", "precurvature"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.sensor.encoder_offset_rad, target,
                      [&](double& offset_rad) { offset_rad += v[0]; });
          },
  };
}

}  // namespace tendril::sim
