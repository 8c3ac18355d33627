// Effect: the gear's efficiency differs from its data sheet.
#include <algorithm>

#include "common.h"

namespace tendril::sim {

Effect GearEfficiency() {
  return {
      .name = "gear_efficiency",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .number = "actuation.gear.efficiency",
      .parameters = {Scale(0.5, 1.2, 0.1)},
      .summary = "the gear's efficiency differs from its data sheet",
      .physics =
          "Driving, the load at the motor is tension x arm / efficiency; driven back, tension x arm x "
          "efficiency. The direction switches over a few milliradians of the shaft. Dry, cold or "
          "lightly loaded gears lose more. Here the efficiency is scale x the nominal one, at most 1.",
      .signature =
          "A loop of torque against tension whose height grows with the tension and does not depend on "
          "speed. Scale above 1 narrows it: at the same torque more tension when pulling, less when "
          "paying out.",
      .experiment =
          "Slow reversals at three levels of co-contraction with a load cell on the motor's side: the "
          "loop's height in proportion to the tension is the gear, the part left at zero tension is "
          "Coulomb friction.",
      .confusable = {"motor_coulomb", "torque_constant", "capstan_alpha"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target, [&](TendonDriveParameters& tendon) {
              tendon.gear.efficiency = std::min(1.0, tendon.gear.efficiency * v[0]);
            });
          },
  };
}

}  // namespace tendril::sim
