// What a robot's numbers amount to: stiffness, sag, frequencies, tension and torque of a full bend. For
// people who write a robot file, not for the tick.
#pragma once

#include <optional>
#include <vector>

#include "tendril/core/robot.h"

namespace tendril::model {

struct SectionFigures {
  double bending_stiffness_Nm2 = 0;  // E I of the backbone
  double stiffness_Nm = 0;  // of the section as a whole, E I / L: moment per bending angle [N·m/rad]
  /// The largest tension that a bend of limits.max_bending_rad takes of any tendon, in the worst of the
  /// directions in which the section's tendons pull, the other sections straight, at rest, under the robot's
  /// own gravity: at the base, and at the motor, past friction that opposes the pull. None where tendons
  /// cannot hold that bend at any tension.
  std::optional<double> full_bend_base_N, full_bend_motor_N;
  /// Motor torque for it, past the gear's losses and the motor's Coulomb friction, and as a share of the
  /// rated torque; the largest of all tendons. None, as the motor's tension, without actuation.
  std::optional<double> full_bend_torque_Nm, full_bend_rated_share;
};

struct Figures {
  double weight_N = 0;      // of all units and the payload, at the robot's gravity
  double pretension_N = 0;  // limits.min_tension_N on each tendon, summed
  /// Distance of the tip, at pretension, from where it is without gravity: as mounted, and with the robot's
  /// gravity (9.81 m/s² where it has none) across its straight axis, along -x. None where it buckles.
  std::optional<double> sag_mounted_m, sag_level_m;
  /// Undamped, ascending, about rest at pretension as mounted. Empty where it buckles.
  std::vector<double> frequencies_Hz;
  std::vector<SectionFigures> sections;
};

/// Throws std::invalid_argument for a body that is none (see Body).
Figures FiguresOf(const RobotParameters& robot);

}  // namespace tendril::model
