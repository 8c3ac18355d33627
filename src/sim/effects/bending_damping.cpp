// Effect: the backbone's bending damping differs.
#include "sections.h"

namespace tendril::sim {

Effect BendingDamping() {
  return {
      .name = "bending_damping",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kMotion,
      .cut_robot_side = Cut::kMotion,
      .on_all = true,
      .on_one = true,
      .number = "body.sections.bending_damping_Nms",
      // The response is nonlinear for a nearly undamped robot, so distant starts are tried as well.
      .parameters = {Scale(0.05, 10, 0.5, {0.3, 4})},
      .summary = "the viscous damping of bending differs by a factor",
      .physics =
          "Every unit of the section resists with scale x c (du/dt, dv/dt). The coefficient cannot be read "
          "from a drawing: it stands for the material, glue, sleeves and the air.",
      .signature =
          "Nothing at rest. After a step the ringing decays slower or faster, and near the body's natural "
          "frequencies amplitude and phase of the tip are wrong; the error grows with speed and vanishes in "
          "slow motion.",
      .experiment = "Steps with holds and a multisine from 0.1 to 10 Hz, the tracker at 100 Hz or more.",
      .confusable = {"unit_mass", "tracker_delay", "motor_viscous", "backbone_hysteresis"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForSections(robot, target, [&](SectionParameters& s) { s.bending_damping_Nms *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
