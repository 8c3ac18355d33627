// Effect: the gain of the load cell differs.
#include "common.h"

namespace tendril::sim {

Effect CellGain() {
  return {
      .name = "cell_gain",
      .stage = Stage::kSensor,
      .scope = Scope::kTendon,
      .cut = Cut::kSensors,
      .cut_robot_side = Cut::kSensors,
      .on_one = true,
      .number = "actuation.load_cell.gain_VpN",
      .parameters = {Scale(0.5, 1.5, 0.05)},
      .summary = "the load cell's calibration factor is off",
      .physics =
          "Reading = scale x tension + offset: another cell, another supply, an amplifier's gain. The real "
          "tension is not affected; a controller that uses the cell is.",
      .signature =
          "The reading differs from what torque, stretch and shape imply, by the same percentage everywhere; "
          "torque against reading looks like another torque constant, and stretch against reading like "
          "another stiffness, at the same time.",
      .experiment =
          "Hang a known mass on the tendon. With the robot: co-contraction at a fixed shape, where "
          "torque, stretch and reading must agree.",
      .confusable = {"torque_constant", "tendon_stiffness", "bending_stiffness"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target, [&](TendonDriveParameters& tendon) {
              tendon.load_cell.gain_VpN *= v[0];
              // Offset in volts of an amplifier, independent of the gain before it.
              tendon.load_cell.offset_N /= v[0];
            });
          },
  };
}

}  // namespace tendril::sim
