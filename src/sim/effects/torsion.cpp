// Effect: the columns of holes are twisted about the backbone.
#include "common.h"

namespace tendril::sim {

Effect Torsion() {
  return {
      .name = "torsion",
      .stage = Stage::kBody,
      .scope = Scope::kRobot,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .parameters = {{.name = "rad_per_m",
                      .nominal = 0,
                      .lower = -15,
                      .upper = 15,
                      .typical = 2,
                      .of = Yardstick::kPerLength}},
      .summary = "the holes turn about the backbone along it: disks glued askew, a twisted wire",
      .physics =
          "The holes of the disk at arc length s are turned by rad_per_m x s about the disk's z. Tendons "
          "become slightly helical: each unit bends in a plane turned slightly from the previous one's, and "
          "the tip leaves the plane of a planar bend. The twist is a shape, not a load: it does not change "
          "with tension.",
      .signature =
          "The tip moves sideways out of the commanded plane, always to the same side, in proportion to the "
          "bend; near the base the plane is right. All tendons alike.",
      .experiment =
          "One tendon pulled alone, each in turn, with position and orientation of the tip: the direction of "
          "the tip's displacement and the plane of its orientation differ by a sixth of the whole twist.",
      .confusable = {"hole_angle", "tracker_rotation"},
      .edit = [](RobotParameters& robot, Target,
                 std::span<const double> v) { robot.body.twist_rad_per_m += v[0]; },
  };
}

}  // namespace tendril::sim
