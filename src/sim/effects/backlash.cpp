// Effect: lost motion between motor shaft and spool.
#include "common.h"

namespace tendril::sim {

Effect Backlash() {
  return {
      .name = "backlash",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kTendon,
      .cut_robot_side = Cut::kTendon,
      .on_one = true,
      .parameters = {{.name = "rad",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 1,
                      .typical = 0.1,
                      .of = Yardstick::kMotorTravel}},
      .summary = "after a reversal the motor turns a little before the spool follows",
      .physics =
          "The shaft crosses a full play of rad (at the motor) before the spool moves: the driven angle is "
          "clamp(driven, shaft, shaft + rad). While the shaft crosses it the spool stands still and its load "
          "stays on the motor. A run begins with the play taken up in the pulling direction.",
      .signature =
          "Tension and shape against motor angle draw a loop: after each reversal the motor turns by the "
          "same angle, whatever the load, while tension and shape stand still. Torque against tension shows "
          "no loop.",
      .experiment =
          "Slow reversals of some tenths of a radian at three levels of co-contraction: the width of "
          "the loop in motor angle is the play and does not change with the level.",
      .confusable = {"slack", "presliding", "encoder_offset", "backbone_hysteresis"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.tendon, target, [&](TendonLaws& tendon) { tendon.play_rad += v[0]; });
          },
  };
}

}  // namespace tendril::sim
