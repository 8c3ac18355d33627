// Effect: the angle over which the gear's losses change direction.
#include "common.h"

namespace tendril::sim {

Effect GearPresliding() {
  return {
      .name = "gear_presliding",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kDrivetrain,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .nuisance = true,
      .number = "actuation.gear.presliding_yields_rad",
      .parameters = {Scale(0.1, 10, 1)},
      .summary = "the gear's friction changes direction over a different angle than nominal",
      .physics =
          "Between driving and being driven the gear's teeth settle over a few milliradians of the "
          "shaft: stop operators of the motor angle, whose yields are all scale x nominal. The "
          "efficiency stays.",
      .signature =
          "Rounder or sharper corners of the loop of torque against tension at each reversal, more so "
          "under load; nothing elsewhere.",
      .experiment = "Reversals of a few encoder counts at high co-contraction, very slow.",
      .confusable = {"motor_presliding", "gear_efficiency", "backlash"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target, [&](TendonDriveParameters& tendon) {
              for (double& yield : tendon.gear.presliding_yields_rad) yield *= v[0];
            });
          },
  };
}

}  // namespace tendril::sim
