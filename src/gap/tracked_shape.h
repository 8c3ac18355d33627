// What the tracker saw against a simulated motion of the body: the tip, the clock, and the tendons'
// shortening by the tracked bend. Knows nothing of channels and cuts.
#pragma once

#include <Eigen/Core>

#include "prepare.h"
#include "tendril/core/robot.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {

/// True where an effect of the robot changes the shape that is read from its tracker.
bool HasTrackerEffect(const RobotParameters& robot);

/// Measured less simulated tip, with the readings `late_s` later than stamped.
struct TipResidual {
  Eigen::MatrixXd
      tip;  // S x (6 + 2K): position, rotation vector, (us, vs) per section; NaN without a reading
  double square_m2 = 0;  // sum over the positions
  double later_s = 0;    // Gauss-Newton step of late_s towards the least squares
};
TipResidual ResidualOfTip(const sim::BodyMotion& motion, const PreparedRun& run, double late_s);

/// Shift of the stamps of a tracker with a free clock: the least squares between the tips; 0 for a run
/// without tip positions, or of states at rest.
double LateByTip(const sim::BodyMotion& motion, const PreparedRun& run);

/// Shortening of the tendons in the body (S x M), with the readings `late_s` later than stamped. The
/// tracker's bend replaces the simulated one at low frequency; the simulation keeps what the tracker's noise
/// hides. The simulated one alone where the tracker does not show the bend of every section.
Eigen::MatrixXd MeasuredShortening(const PreparedRun& run, const RobotParameters& robot,
                                   const sim::BodyMotion& motion, double late_s);

}  // namespace tendril::gap
