// Effect: the tracker's origin is not the robot's.
#include "common.h"

namespace tendril::sim {

Effect TrackerOffset() {
  return {
      .name = "tracker_offset",
      .stage = Stage::kSensor,
      .scope = Scope::kRobot,
      .cut = Cut::kSensors,
      .cut_robot_side = Cut::kSensors,
      .frame = true,
      .parameters = {{.name = "x_m",
                      .nominal = 0,
                      .lower = -0.05,
                      .upper = 0.05,
                      .typical = 0.002,
                      .of = Yardstick::kLength},
                     {.name = "y_m",
                      .nominal = 0,
                      .lower = -0.05,
                      .upper = 0.05,
                      .typical = 0.002,
                      .of = Yardstick::kLength},
                     {.name = "z_m",
                      .nominal = 0,
                      .lower = -0.05,
                      .upper = 0.05,
                      .typical = 0.002,
                      .of = Yardstick::kLength}},
      .summary = "the tracker's origin is not at the robot's base",
      .physics =
          "Reported position = R p + (x_m, y_m, z_m). A marker beside the tip's centre looks the same as "
          "long as the tip does not turn.",
      .signature = "The tip is off by the same vector everywhere; the orientation is right.",
      .experiment = "The straight robot, at rest: its tip is one length above the base.",
      .confusable = {"tracker_rotation", "unit_length", "precurvature"},
      .add =
          [](PlantLaws& laws, const RobotParameters&, Target, std::span<const double> v) {
            laws.sensor.tracker_offset_m += Eigen::Vector3d(v[0], v[1], v[2]);
          },
  };
}

}  // namespace tendril::sim
