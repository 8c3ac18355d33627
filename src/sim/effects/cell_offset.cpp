// Effect: the load cell has an offset at zero tension.
#include "common.h"

namespace tendril::sim {

Effect CellOffset() {
  return {
      .name = "cell_offset",
      .stage = Stage::kSensor,
      .scope = Scope::kTendon,
      .cut = Cut::kSensors,
      .cut_robot_side = Cut::kSensors,
      .on_one = true,
      // Near a slack tendon a small step does not predict a large one.
      .parameters = {{.name = "N",
                      .nominal = 0,
                      .lower = -2,
                      .upper = 2,
                      .typical = 0.05,
                      .starts = {-0.2, 0.2},
                      .of = Yardstick::kTension}},
      .summary = "the load cell's zero is off",
      .physics =
          "Reading = gain x tension + N: an amplifier's offset, a cell mounted under stress, a tare that was "
          "taken with tension on it. The real tension is not affected; a controller that uses the cell is.",
      .signature =
          "The reading differs from what torque, stretch and shape imply by the same newtons, at every "
          "tension and time.",
      .experiment = "Read the cells with loose tendons: what they show then is the offset.",
      .confusable = {"cell_drift", "encoder_offset", "slack"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.load_cell.offset_N += v[0]; });
          },
  };
}

}  // namespace tendril::sim
