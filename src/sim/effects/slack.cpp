// Effect: the tendon is longer than at its pretension.
#include "common.h"

namespace tendril::sim {

Effect Slack() {
  return {
      .name = "slack",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kTendon,
      .cut_robot_side = Cut::kTendon,
      .on_one = true,
      .element = Element::kTendon,
      .zero = true,
      .parameters = {{.name = "m",
                      .nominal = 0,
                      .lower = 0,
                      .upper = 0.005,
                      .typical = 0.0002,
                      .of = Yardstick::kTendonTravel}},
      .summary = "the tendon is too long when the run begins",
      .physics =
          "Stretch is counted from the pretensioned straight robot; the tendon has m more length than "
          "that. If m exceeds the stretch of the pretension the tendon hangs loose until the spool has "
          "wound the rest: a tendon only pulls.",
      .signature =
          "Throughout a run the motor angle is ahead of tension and shape by the same length, and at the "
          "beginning the motor turns without tension.",
      .experiment =
          "Wind each tendon in slowly from loose until its load cell responds, then compare with the "
          "encoder's zero.",
      .confusable = {"encoder_offset", "tendon_creep", "backlash"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target target, std::span<const double> v) {
            ForTarget(laws.tendon, target, [&](TendonLaws& tendon) { tendon.slack_m += v[0]; });
          },
  };
}

}  // namespace tendril::sim
