// From the path of the motors: where they were a little before, and in which direction each tendon slid last.
#pragma once

#include <Eigen/Core>

#include "states.h"

namespace tendril::gap {

/// S x M [rad]: where the motors were `lag_s` + `drift` t before each state, t after the run's first reading,
/// interpolated between their readings. As in the states themselves where most of these are one reading only:
/// how the motors moved between them is not known.
Eigen::MatrixXd AnglesBefore(const States& run, double lag_s, double drift);

/// S x M, the mean over each state's readings: 1 where the motor has pulled the tendon by twice the
/// pre-sliding since it turned round, -1 where it has paid it out, 0 before any motion. `travel_m`: pull of
/// each tendon per motor angle, `presliding_m` > 0; M entries each.
Eigen::MatrixXd SlidingOf(const States& run, const Eigen::VectorXd& travel_m,
                          const Eigen::VectorXd& presliding_m);

}  // namespace tendril::gap
