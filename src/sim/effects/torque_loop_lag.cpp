// Effect: the drive's current loop is slower than nominal.
#include "common.h"

namespace tendril::sim {

Effect TorqueLoopLag() {
  return {
      .name = "torque_loop_lag",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kCurrentLoop,
      .cut_robot_side = Cut::kCurrentLoop,
      .on_one = true,
      .parameters = {{.name = "s", .nominal = 0, .lower = 0, .upper = 0.05, .typical = 0.003}},
      .summary = "the drive's torque follows its target more slowly than nominal",
      .physics =
          "The current loop is a first-order lag; its time constant is the nominal one plus s. A badly tuned "
          "or voltage-limited current controller, or an output filter, adds to it.",
      .signature =
          "Reported torque trails the target: steps become exponentials, a ramp is late by s, fast "
          "sines lose amplitude. Reported torque and tension agree.",
      .experiment =
          "Torque steps, or a multisine of 1 to 100 Hz: a lag loses amplitude as the frequency rises, a "
          "delay does not.",
      .confusable = {"command_delay", "motor_viscous"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.motor.torque_lag_s += v[0]; });
          },
  };
}

}  // namespace tendril::sim
