// Effect: the tendon is stiffer or softer than drawn.
#include "common.h"

namespace tendril::sim {

Effect TendonStiffness() {
  return {
      .name = "tendon_stiffness",
      .stage = Stage::kTransmission,
      .scope = Scope::kTendon,
      .cut = Cut::kTendon,
      .cut_robot_side = Cut::kTendon,
      .on_one = true,
      .element = Element::kTendon,
      .number = "actuation.tendon.stiffness_Npm",
      .parameters = {Scale(0.05, 5, 0.2)},
      .summary = "the tendon stretches more or less than nominal",
      .physics =
          "The tendon with its ends, knots and the frame behind its pulleys is a spring of scale x "
          "nominal stiffness. Used ropes settle and get stiffer; a loose clamp gets softer.",
      .signature =
          "Motor angle against tension at a fixed shape has another slope; the tip trails or leads the "
          "motor in proportion to the tension. Scale above 1: more tension for the same motor angle and "
          "shape.",
      .experiment =
          "Co-contraction at a fixed shape: all tendons tensed together bend nothing, and what the "
          "motors turn is stretch.",
      .confusable = {"cell_gain", "slack", "tendon_creep"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForTendons(robot, target,
                       [&](TendonDriveParameters& tendon) { tendon.tendon.stiffness_Npm *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
