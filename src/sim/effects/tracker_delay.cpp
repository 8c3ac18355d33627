// Effect: the tracker's delay.
#include "common.h"

namespace tendril::sim {

Effect TrackerDelay() {
  return {
      .name = "tracker_delay",
      .stage = Stage::kSensor,
      .scope = Scope::kRobot,
      .cut = Cut::kSensors,
      .cut_robot_side = Cut::kSensors,
      .parameters = {{.name = "s", .nominal = 0, .lower = 0, .upper = 0.5, .typical = 0.02}},
      .summary = "the tracker reports the tip's pose late",
      .physics = "Exposure, image processing and transport delay the pose by s beyond the nominal delay.",
      .signature =
          "The tip is late by the same time at every frequency: off in proportion to its speed, right "
          "at rest.",
      .experiment =
          "Motions of one path at two speeds, or a multisine of 0.1 to 10 Hz: a delay shifts the phase "
          "and leaves the amplitude, damping changes both near resonance.",
      .confusable = {"command_delay", "bending_damping"},
      .edit =
          [](RobotParameters& robot, Target, std::span<const double> v) {
            if (robot.actuation && robot.actuation->tracker) robot.actuation->tracker->delay_s += v[0];
          },
  };
}

}  // namespace tendril::sim
