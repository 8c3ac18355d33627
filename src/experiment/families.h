// The shapes of the known families of experiments, each as large and as quick as a robot allows. Knows
// nothing of plans and their files.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <string_view>

#include "allowance.h"

namespace tendril::experiment {

struct Asked {
  double amplitude_rad, active_s, largest_N;
  std::uint64_t seed;
  const ControllerParameters& controller;
  int rows() const { return static_cast<int>(std::lround(active_s / kStep_s)) + 1; }
  double FastestBending() const { return kRateShare * controller.trajectory.max_rate_radps; }
};

/// Targets, one row a step: tensions at the base, or bends.
struct Targets {
  Eigen::MatrixXd rows;
  bool tension;
};

/// Of a family of kFamilies.
Targets FamilyTargets(std::string_view family, Allowance& robot, const Asked& asked);

/// Limits the rate to that of the controller for tension targets, so that the plan equals the targets sent.
Eigen::MatrixXd RateLimited(Eigen::MatrixXd command, const ControllerParameters& controller);

}  // namespace tendril::experiment
