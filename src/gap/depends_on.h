// Whether what runs do not repeat follows a state. Knows nothing of robots' files, channels or verdicts.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tendril::gap {

/// Runs of the same commands in one channel: rows are the windows of the first run of the first group, then
/// of its next run, and so on.
struct Repetitions {
  struct Group {
    Eigen::Index windows = 0, runs = 0;
  };
  struct Motor {
    std::string name, tendon;  // "motor 2", "tendon 2"
    double gear_ratio = 1;     // turns for one of its spool
    Eigen::VectorXd angle_rad, velocity_radps, tension_N;
  };

  std::vector<Group> groups;
  double window_s = 0;
  Eigen::VectorXd residual, time_s;  // the residual over the rms that the sensors leave in it
  std::vector<Motor> motors;
  bool angles = false;      // of its motors are asked for
  bool conditions = false;  // what a scatter of friction follows too is asked for
};

struct Dependence {
  int channel = 0;
  std::string on;      // "the angle of motor 2, 3 times a turn"
  double p_value = 1;  // of chance making as much of any of the states that were tried
  bool law = false;    // a periodic function of an angle, of which each run stands elsewhere
};

/// What runs differ by as torque or friction that is periodic in the angle of a motor or its spool; else,
/// where `conditions` are asked for, in proportion to a condition, each run by a factor of its own, or to the
/// number of the repetition. Nothing where chance makes as much of all that was tried in one of a hundred
/// data sets, or where it is less than half of the rms.
std::optional<Dependence> DependsOn(const std::vector<Repetitions>& channels, std::uint64_t seed);

}  // namespace tendril::gap
