// Effect: the angle over which the motor's dry friction builds up.
#include "common.h"

namespace tendril::sim {

Effect MotorPresliding() {
  return {
      .name = "motor_presliding",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .nuisance = true,
      .number = "actuation.motor.coulomb_angle_rad",
      .parameters = {Scale(0.1, 10, 1)},
      .summary = "the motor's dry friction builds up over a different angle than nominal",
      .physics =
          "After a reversal the friction torque swings from one sign to the other over a few "
          "milliradians (Dahl: it approaches its full value exponentially with the angle moved). The "
          "angle is scale x nominal; the full friction stays.",
      .signature =
          "Rounder or sharper corners of the loop of torque against tension, within milliradians of "
          "each reversal; nothing elsewhere.",
      .experiment = "Reversals of a few encoder counts at constant co-contraction, very slow.",
      .confusable = {"gear_presliding", "motor_coulomb"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.motor.coulomb_angle_rad *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
