// Effect: the motor's torque constant differs from its data sheet.
#include "common.h"

namespace tendril::sim {

Effect TorqueConstant() {
  return {
      .name = "torque_constant",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .number = "actuation.motor.torque_constant_NmpA",
      .parameters = {Scale(0.5, 1.5, 0.1)},
      .summary = "the motor's real torque per ampere differs from its data sheet",
      .physics =
          "The drive knows only the current: it reports current x nominal torque constant, while the "
          "shaft receives scale x that. A hot magnet loses 0.1 to 0.2 % per kelvin, and copies of one "
          "motor scatter by several per cent.",
      .signature =
          "The tension at the load cell is off in proportion to the torque, alike for pulling and "
          "paying out and at every speed (above 1: more tension than the torque explains). Commanded "
          "and reported torque agree.",
      .experiment =
          "Slow triangles at two levels of co-contraction with a load cell on the motor's side: the "
          "mean of the pulling and the paying-out branch, torque against tension, has the slope of the "
          "constant; half their distance is friction.",
      .confusable = {"cell_gain", "gear_efficiency"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.motor.torque_scale *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
