// Effect: the displacement over which the pulleys' friction builds up.
#include "common.h"

namespace tendril::sim {

Effect Presliding() {
  return {
      .name = "presliding",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kDrivetrain,
      .on_one = true,
      .nuisance = true,
      .number = "actuation.transmission.presliding_m",
      .parameters = {Scale(0.1, 10, 1)},
      .summary = "the pulleys' friction builds up over a different displacement than nominal",
      .physics =
          "After a reversal the tendon creeps before it slides: friction swings from one sign to the "
          "other over a displacement of scale x nominal (stop operators of 1/4, 1/2, 3/4 and all of "
          "it). Sliding friction stays.",
      .signature =
          "Rounder or sharper corners of the loop of tension or shape against displacement, within some "
          "tens of micrometres of each reversal; nothing elsewhere.",
      .experiment = "Very slow reversals of a tenth of a millimetre.",
      .confusable = {"backlash", "backbone_hysteresis", "gear_presliding"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.transmission.presliding_m *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
