// Effect: the tendons' holes are rotated about the backbone.
#include "sections.h"

namespace tendril::sim {

Effect HoleAngle() {
  return {
      .name = "hole_angle",
      .stage = Stage::kBody,
      .scope = Scope::kTendon,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .on_all = true,
      .on_one = true,
      .number = "body.sections.tendons.angle_rad",
      .parameters = {{.name = "rad", .nominal = 0, .lower = -0.5, .upper = 0.5, .typical = 0.05}},
      .summary = "the tendons pull towards a different angle than drawn",
      .physics =
          "The tendon's holes are at angle + rad in every disk. `all`: the whole pattern is turned against "
          "the base, an assembly or homing error. One: a misdrilled column of holes.",
      .signature =
          "The bend leaves the commanded plane by a constant angle, whatever its size; when all are turned "
          "the tip's path is the right one turned about the base's z axis, and nothing else is wrong.",
      .experiment =
          "Pull each tendon alone and observe the plane in which the tip moves. With all turned alike, "
          "gravity at a slant or the tip's own orientation is needed to tell the holes from the tracker.",
      .confusable = {"tracker_rotation", "torsion", "hole_radius"},
      .edit =
          [](RobotParameters& robot, Target target, std::span<const double> v) {
            ForRoutes(robot, target, [&](TendonRoute& route) { route.angle_rad += v[0]; });
          },
  };
}

}  // namespace tendril::sim
