// Effect: viscous friction of the motor differs from its nominal value.
#include "common.h"

namespace tendril::sim {

Effect MotorViscous() {
  return {
      .name = "motor_viscous",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .number = "actuation.motor.viscous_friction_Nms",
      .parameters = {Scale(0, 200, 20)},
      .summary = "the motor's viscous friction, a brake in proportion to its speed, differs from nominal",
      .physics =
          "A torque of scale x nominal x speed against the motion: grease, eddy currents, air. The "
          "nominal value of a small motor is so low that a stiff grease can multiply it.",
      .signature =
          "The difference between torque and tension grows in proportion to the speed and vanishes at "
          "rest; a fast run shows it, a slow one does not.",
      .experiment =
          "A ladder of constant speeds through zero, up and down: the slope of torque against speed at "
          "equal tension.",
      .confusable = {"stribeck", "torque_loop_lag", "bending_damping"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.motor.viscous_friction_Nms *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
