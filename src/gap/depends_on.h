// Whether what runs do not repeat depends on a state that they reach otherwise. Knows nothing of robots'
// files, channels or verdicts.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tendril::gap {

/// A motor that a channel may depend on, in W windows of n runs of the same commands.
struct RepeatedMotor {
  std::string name;                           // "motor 2"
  double gear_ratio = 1;                      // turns for one of its spool
  Eigen::MatrixXd angle_rad, velocity_radps;  // W x n
};

/// A state that all runs of a group share but for their scatter.
struct Condition {
  std::string name, unit;
  Eigen::VectorXd value;  // W
};

/// A run and its repetitions, n in all, in one channel.
struct Repetitions {
  Eigen::VectorXi block;  // W: windows of one number may hang together
  double window_s = 0;
  Eigen::MatrixXd off;  // W x n: of each run from the mean of all, over the rms of the sensors' noise
  std::vector<RepeatedMotor> motors;
  std::vector<Condition> conditions;  // in all groups in the same order, the last ones may be missing
};

struct Dependence {
  std::string on;      // "the angle of motor 2, 3 times a turn"
  double p_value = 1;  // of chance making as much of any of the states that were tried
  bool law = false;    // a run's deviation follows from its state; else only how much runs scatter does
};

/// What `channels` (each: its groups) depend on for sure (chance makes as much of all that was tried in one
/// of a hundred data sets at most), with the index of the channel that shows it most; nothing where no state
/// does. Tried are functions of each motor's and spool's angle, as torque and as friction, then the order of
/// the repetitions, then how much runs scatter over each condition.
std::optional<std::pair<int, Dependence>> DependsOn(const std::vector<std::vector<Repetitions>>& channels,
                                                    std::uint64_t seed);

}  // namespace tendril::gap
