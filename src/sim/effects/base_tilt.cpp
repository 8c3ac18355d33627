// Effect: the base is tilted relative to the robot file.
#include <Eigen/Geometry>

#include "common.h"

namespace tendril::sim {

Effect BaseTilt() {
  const EffectParameter x{.name = "x_rad", .nominal = 0, .lower = -0.8, .upper = 0.8, .typical = 0.05};
  EffectParameter y = x;
  y.name = "y_rad";
  return {
      .name = "base_tilt",
      .stage = Stage::kBody,
      .scope = Scope::kRobot,
      .cut = Cut::kShape,
      .cut_robot_side = Cut::kShape,
      .parameters = {x, y},
      .summary = "the base is turned about its x and y against gravity",
      .physics =
          "The base is turned by the rotation vector w = (x_rad, y_rad, 0) from its nominal orientation, and "
          "the tracker with it: in the base frame F_0 gravity becomes R(w)^T g. Nothing else changes.",
      .signature =
          "The robot leans to one fixed side, in proportion to its weight: small on a light robot, the same "
          "at every bend of the upright robot, and hidden where tensions make it stiff.",
      .experiment =
          "A level on the base; or the same run with the base rolled by half a turn: a tilt of the table "
          "stays where it is, a bent backbone turns with it. A known mass at the tip makes it larger.",
      .confusable = {"precurvature", "tip_force", "tip_payload", "tracker_rotation"},
      .edit =
          [](RobotParameters& robot, Target, std::span<const double> v) {
            const Eigen::Vector3d turn(v[0], v[1], 0);
            const double angle = turn.norm();
            if (angle == 0) return;
            robot.body.gravity_W_mps2 = Eigen::AngleAxisd(-angle, turn / angle) * robot.body.gravity_W_mps2;
          },
  };
}

}  // namespace tendril::sim
