// Effect: a command acts later than nominal.
#include "common.h"

namespace tendril::sim {

Effect CommandDelay() {
  return {
      .name = "command_delay",
      .stage = Stage::kDrive,
      .scope = Scope::kTendon,
      .cut = Cut::kCurrentLoop,
      .cut_robot_side = Cut::kCurrentLoop,
      .on_one = true,
      .parameters = {{.name = "s", .nominal = 0, .lower = 0, .upper = 0.05, .typical = 0.003}},
      .summary = "a torque command takes effect later than nominal",
      .physics =
          "Gateways, drives that take a command one or more cycles late, and filters with a fixed "
          "number of taps shift the target by s before the current loop sees it.",
      .signature =
          "Reported torque is the target shifted in time: all frequencies late by the same time, none "
          "weakened.",
      .experiment =
          "Torque steps, or a multisine of 1 to 100 Hz: the phase falls in proportion to the frequency "
          "at constant amplitude.",
      .confusable = {"torque_loop_lag"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.tendon, target, [&](TendonLaws& tendon) { tendon.command_delay_s += v[0]; });
          },
  };
}

}  // namespace tendril::sim
