// Many simulated robots under the same torques, each on a plant of its own, on all cores: for parameter
// studies. Knows nothing of controllers.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/sim/plant.h"

namespace tendril::sim {

/// Row i holds from i step_s to (i + 1) step_s; S x M [N·m].
struct TorqueProgram {
  double step_s = 0;
  Eigen::MatrixXd torque_Nm;
};

/// True values at the ends of the program's S steps. Where the solver gave up, `failed` says why and the rows
/// from there on are NaN.
struct PlantMotion {
  Eigen::MatrixXd tip_m;            // S x 3, in F_0
  Eigen::MatrixXd bending_rad;      // S x 2K, (us, vs) of each section
  Eigen::MatrixXd tension_base_N;   // S x M
  Eigen::MatrixXd tension_motor_N;  // S x M
  Eigen::MatrixXd motor_angle_rad;  // S x M
  std::string failed;
};

/// One motion a robot, whatever the number of threads the same to the last bit. Throws std::invalid_argument
/// for a program without rows or of another number of tendons, for a torque that is not finite and for a
/// robot that is no plant. `progress` gets the share of the steps that are done, from any thread; `stop`,
/// once true, leaves what is not done NaN. A motion that takes more solver steps than `most_steps_per_row` on
/// average, after some rows, is given up as too slow.
std::vector<PlantMotion> SimulateEach(std::span<const RobotParameters> robots, const TorqueProgram& program,
                                      const PlantOptions& options, int threads,
                                      const std::atomic<bool>* stop = nullptr,
                                      const std::function<void(double share)>& progress = {},
                                      double most_steps_per_row = std::numeric_limits<double>::infinity());

}  // namespace tendril::sim
