// Effect: the backbone is stiffer or softer than its data sheet states.
#include "sections.h"

namespace tendril::sim {

Effect BendingStiffness() {
  return {
      .name = "bending_stiffness",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .number = "body.sections.youngs_modulus_Pa",
      .parameters = {Scale(0.3, 3, 0.1)},
      .summary = "the backbone's bending stiffness differs from E pi r^4 / 4 by a factor",
      .physics =
          "Every unit of the section resists bending with scale x EI / l. The radius enters to the fourth "
          "power: 1 % more wire is 4 % more stiffness. NiTi's modulus depends on alloy, temperature and "
          "training (some 25 to 80 GPa), and glue, sleeves or electric cables along the backbone add their "
          "own.",
      .signature =
          "The same tensions bend the robot less (scale above 1) or more, in every direction alike, in "
          "proportion to the bend and without a loop; also at rest frequencies rise with the root of the "
          "scale.",
      .experiment =
          "Slow pulls in several directions with the load cell at the base's side of the pulleys, at one low "
          "and one high co-contraction: tendon softening grows with the sum of tensions, an error of EI does "
          "not. Turning the robot against gravity separates it from payload.",
      .confusable = {"unit_length", "hole_radius", "capstan_alpha", "superelastic", "unit_stiffness"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForSections(robot, target, [&](SectionParameters& s) { s.youngs_modulus_Pa *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
