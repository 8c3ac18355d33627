// Effect: the zero of the load cell drifts.
#include "common.h"

namespace tendril::sim {

Effect CellDrift() {
  return {
      .name = "cell_drift",
      .stage = Stage::kSensor,
      .scope = Scope::kTendon,
      .cut = Cut::kSensors,
      .cut_robot_side = Cut::kSensors,
      .on_one = true,
      .parameters = {{.name = "N_per_s",
                      .nominal = 0,
                      .lower = -0.1,
                      .upper = 0.1,
                      .typical = 0.02,
                      .of = Yardstick::kTension}},
      .summary = "the load cell's zero wanders during a run",
      .physics = "Reading = tension + N_per_s x time since the start: a bridge or amplifier warming up.",
      .signature =
          "The difference of the reading from what torque, stretch and shape imply grows steadily with time, "
          "whatever the motion.",
      .experiment = "Read the cells at rest before and after a run.",
      .confusable = {"cell_offset", "tendon_creep"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.sensor.cell_drift_Nps, target, [&](double& drift_Nps) { drift_Nps += v[0]; });
          },
  };
}

}  // namespace tendril::sim
