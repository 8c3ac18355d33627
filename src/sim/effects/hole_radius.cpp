// Effect: the tendons' holes lie farther out or in than drawn.
#include "sections.h"

namespace tendril::sim {

Effect HoleRadius() {
  return {
      .name = "hole_radius",
      .stage = Stage::kBody,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .number = "body.sections.tendons.radius_m",
      .parameters = {Scale(0.7, 1.3, 0.05)},
      .summary = "the lever of the tendons about the backbone differs from the drawing",
      .physics =
          "The tendon passes the disks at scale x r. Its moment per newton and its shortening per radian "
          "both grow with the radius: work is the same. A tendon of 0.5 mm in a hole of 0.8 mm lies against "
          "the hole's outer side when it bends the robot towards itself, which alone moves it by 0.15 mm.",
      .signature =
          "Bend per tension and tendon displacement per bend are wrong in the same sense and by the same "
          "factor; a stiffness error leaves the displacement right. One tendon alone: only bends towards and "
          "away from it are wrong.",
      .experiment =
          "Slow bends in every direction with encoders and the tip's orientation: displacement over bend is "
          "the lever, without any force in it.",
      .confusable = {"bending_stiffness", "spool_growth", "hole_angle", "tendon_stiffness"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForRoutes(robot, target, [&](TendonRoute& route) { route.radius_m *= v[0]; });
          },
  };
}

}  // namespace tendril::sim
