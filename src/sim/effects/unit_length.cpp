// Effect: the units are longer or shorter than drawn.
#include "sections.h"

namespace tendril::sim {

Effect UnitLength() {
  return {
      .name = "unit_length",
      .stage = Stage::kBody,
      .scope = Scope::kSection,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .number = "body.sections.unit_length_m",
      .parameters = {Scale(0.8, 1.2, 0.02)},
      .summary = "the distance between disks differs from the drawing by a factor",
      .physics =
          "The units are scale x l long. Shape and forces both change: the tip moves farther per bend, the "
          "units are softer (EI / l), gravity has a longer lever, and straight tendons between the disks "
          "soften the robot more.",
      .signature =
          "The tip's position is wrong already when straight, along the backbone, and in proportion to the "
          "distance from the base; its orientation is nearly right. Bending per tension grows with the "
          "scale.",
      .experiment =
          "The straight pose under equal tensions: the tip's height over the base is the length, without any "
          "force in it. Then one slow bend.",
      .confusable = {"bending_stiffness", "tracker_offset", "unit_mass"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForSections(robot, target, [&](SectionParameters& s) { s.unit_length_m *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
