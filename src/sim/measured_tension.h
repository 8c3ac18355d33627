// Tensions on the body from measured signals, each by what is known of the way to the base. Knows nothing of
// gaps, noise or sensors' errors.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "body_motion.h"
#include "drivetrain.h"
#include "sampled.h"

namespace tendril::sim {

/// Base tensions (S x M), independent of the body.
std::unique_ptr<TensionSource> GivenTension(Eigen::MatrixXd tension_N, Grid grid);

/// All S x M: pull of the spools and its rate, and the pulleys' map of the motor-side tension.
struct PulleySignals {
  Eigen::MatrixXd spool_m, spool_rate_mps, middle_N, half_N;
};
/// Base tensions behind the pulleys, from known motor-side tensions and spools: only the sliding state
/// depends on the body. Tendons without a motor slide by the body's full shortening.
std::unique_ptr<TensionSource> PulleyTension(PulleySignals signals, const std::vector<double>& presliding_m,
                                             const std::vector<char>& no_motor, Grid grid);

/// Base tensions of the tendons' springs between measured motors (S x M) and the body.
std::unique_ptr<TensionSource> SpringTension(Eigen::MatrixXd angle_rad, Eigen::MatrixXd velocity_radps,
                                             std::vector<Drivetrain> drive, Grid grid);

/// Base tensions of `cells`, and of `springs` where there is no cell (S x M).
using NoCell = Eigen::Matrix<char, Eigen::Dynamic, Eigen::Dynamic>;
std::unique_ptr<TensionSource> MixedTension(std::unique_ptr<TensionSource> cells,
                                            std::unique_ptr<TensionSource> springs, NoCell no_cell,
                                            Grid grid);

}  // namespace tendril::sim
