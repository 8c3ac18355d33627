// Effect: the drive's torque saturates below its own limit.
#include <algorithm>

#include "common.h"

namespace tendril::sim {

Effect TorqueSaturation() {
  return {
      .name = "torque_saturation",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kCurrentLoop,
      .cut_robot_side = Cut::kCurrentLoop,
      .on_one = true,
      .parameters = {{.name = "deficit_Nm",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 0.007,
                      .typical = 0.004,
                      .of = Yardstick::kTorqueLimit}},
      .summary = "the drive limits the torque below the limit in its data sheet",
      .physics =
          "The target is clipped to +-(torque constant x current limit - deficit_Nm): a thermal "
          "derating, a supply that sags, or a limit set too low. Nothing happens below it.",
      .signature =
          "Reported torque follows the target up to a level and stays there; the level is the same for "
          "all motions.",
      .experiment = "A slow ramp of one tendon's tension to the limit.",
      .confusable = {"torque_loop_lag", "torque_constant"},
      .add =
          [](PlantLaws& laws, const RobotParameters& robot, Target target, std::span<const double> v) {
            if (!robot.actuation) return;
            for (int j = 0; j < static_cast<int>(laws.tendon.size()); ++j) {
              if (target && *target != j) continue;
              const TendonDriveParameters& tendon = robot.actuation->tendons[static_cast<std::size_t>(j)];
              const double own_Nm = tendon.motor.torque_constant_NmpA * tendon.drive.current_limit_A;
              double& limit_Nm = laws.tendon[static_cast<std::size_t>(j)].torque_limit_Nm;
              limit_Nm = std::min(limit_Nm, std::max(0.0, own_Nm - v[0]));
            }
          },
  };
}

}  // namespace tendril::sim
