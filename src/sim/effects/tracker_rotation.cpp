// Effect: the tracker's axes are not the robot's.
#include "common.h"

namespace tendril::sim {

Effect TrackerRotation() {
  return {
      .name = "tracker_rotation",
      .stage = Stage::kSensor,
      .scope = Scope::kRobot,
      .cut = Cut::kSensors,
      .cut_robot_side = Cut::kSensors,
      .frame = true,
      .parameters = {{.name = "x_rad", .nominal = 0, .lower = -0.5, .upper = 0.5, .typical = 0.02},
                     {.name = "y_rad", .nominal = 0, .lower = -0.5, .upper = 0.5, .typical = 0.02},
                     {.name = "z_rad", .nominal = 0, .lower = -0.5, .upper = 0.5, .typical = 0.02}},
      .summary = "the tracker's frame is turned against the robot's base",
      .physics =
          "Reported position = R p + offset and reported orientation = R R_tip, R the rotation by the "
          "vector (x_rad, y_rad, z_rad): camera and base were not aligned well.",
      .signature =
          "The tip is off in proportion to its distance from the base, at rest too; the straight robot seems "
          "to lean. Forces, angles and gravity are not affected.",
      .experiment =
          "Register the tracker to markers on the base plate. A tilted base, in contrast, also changes "
          "what gravity does.",
      .confusable = {"base_tilt", "tracker_offset", "precurvature", "hole_angle"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target, std::span<const double> v) {
            laws.sensor.tracker_turn_rad += Eigen::Vector3d(v[0], v[1], v[2]);
          },
  };
}

}  // namespace tendril::sim
