// The body that only bends as the projection of one that also twists, stretches and shears: what a controller
// knows of it, and how far off that is. For programs, not for the tick.
#pragma once

#include <optional>

#include "tendril/core/limits.h"
#include "tendril/core/robot.h"

namespace tendril::model {

/// One unit a disk, without torsion, extension and shear: the same disks, masses, stiffness and damping of
/// bending. A body that only bends comes back as it is.
BodyParameters BendingModel(const BodyParameters& body);
/// The robot with this body and its holes aligned (AlignHoles): what controls and plans knows of it.
RobotParameters ControlModel(RobotParameters robot);

/// The largest distance of the bending model's tip from the body's own, over the robot's loads: all tendons
/// at limits.min_tension_N, and each in turn at limits.max_tension_base_N beside them, under its gravity and
/// tip force. None where one of the two has no equilibrium under any of these loads.
std::optional<double> WorstTipErrorOfBending(const RobotParameters& robot);

/// What the tendons' shortening does not show of the sections' bend where the body has other strains too:
/// second moment [rad^2] of the bend of its equilibria less that which the bending model has for the same
/// shortenings since all tendons were at limits.min_tension_N, over the same loads; the error that the
/// model's own equilibria have so (arcs of even curvature, the sag at the zero) is subtracted. Zero for a
/// body that only bends; loads without an equilibrium do not count.
BendingMatrix UnseenBending(const RobotParameters& robot);

}  // namespace tendril::model
