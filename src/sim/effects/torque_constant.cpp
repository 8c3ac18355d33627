// Effect: the motor makes more or less torque per ampere than its data sheet says.
#include "common.h"

namespace tendril::sim {

Effect TorqueConstant() {
  return {
      .name = "torque_constant",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_all = true,
      .on_one = true,
      .parameters = {Scale(0.5, 1.5, 0.1)},
      .summary = "the motor's real torque per ampere differs from its data sheet",
      .physics =
          "The drive knows only the current. It reports current x nominal torque constant, while the shaft "
          "receives scale x that: a hot magnet loses 0.1 to 0.2 % per kelvin, a motor's constant scatters by "
          "several per cent between copies.",
      .signature =
          "The tension that the load cell reads is off in proportion to the torque, alike for pulling and "
          "paying out, and independent of speed; commanded and reported torque agree.",
      .experiment =
          "Two slow triangles at different tensions with a load cell on the motor's side: the mean of the "
          "pulling and the paying-out branch against torque gives the scale, their distance the friction.",
      .confusable = {"gear_efficiency", "cell_gain"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.motor.torque_scale *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
