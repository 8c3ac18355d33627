// Effect: dry friction of the motor differs from its nominal value.
#include "common.h"

namespace tendril::sim {

Effect MotorCoulomb() {
  return {
      .name = "motor_coulomb",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .number = "actuation.motor.coulomb_friction_Nm",
      .parameters = {Scale(0, 10, 0.5)},
      .summary = "the motor's dry friction is larger or smaller than nominal",
      .physics =
          "A torque of scale x nominal against the motion at any speed and load, building up over the "
          "nominal pre-sliding angle after each reversal. Brushes, seals and bearing preload make it; it "
          "falls while a motor runs in.",
      .signature =
          "A loop of torque against tension with constant height, the same at every speed and load. "
          "Scale above 1: less tension at the same torque when pulling, more when paying out.",
      .experiment =
          "A slow triangle at the least co-contraction: the loop's height there is almost only Coulomb "
          "friction. Repeat at twice the speed (no change) and at twice the tension (no change).",
      .confusable = {"gear_efficiency", "stribeck", "pulley_coulomb"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.motor.coulomb_friction_Nm *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
