// Whether the differences between repeated runs follow a state. Knows nothing of robot files, channels or
// verdicts.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tendril::gap {

/// A disturbance of a motor lasts up to this: windows within it are one draw of chance.
inline constexpr double kDisturbance_s = 0.5;

/// Repeated runs in one channel: rows are the windows of the first run of the first group, then of its next
/// run, and so on.
struct Repetitions {
  struct Group {
    Eigen::Index windows = 0, runs = 0;
  };
  struct Motor {
    std::string name, tendon;  // "motor 2", "tendon 2"
    double gear_ratio = 1;     // motor turns per turn of its spool
    Eigen::VectorXd angle_rad, velocity_radps, tension_N;
  };

  std::vector<Group> groups;
  double window_s = 0;
  Eigen::VectorXd residual, time_s;  // the residual over the rms that the sensors leave in it
  std::vector<Motor> motors;
  bool angles = false;      // whether to try functions of motor angles
  bool conditions = false;  // whether to try conditions that friction scatter may follow too
};

struct Dependence {
  int channel = 0;
  std::string on;      // "the angle of motor 2, 3 times a turn"
  double p_value = 1;  // probability that chance gives as much for any of the states tried
  bool law = false;    // a periodic function of an angle which differs between the runs
};

/// Explains the differences by torque or friction that is periodic in the angle of a motor or its spool.
/// Failing that, where `conditions` is set, by a condition scaled by a factor of each run, or by the number
/// of the repetition. Empty where chance gives as much in one of a hundred data sets, or where the
/// explanation covers less than half of the rms.
std::optional<Dependence> DependsOn(const std::vector<Repetitions>& channels, std::uint64_t seed);

}  // namespace tendril::gap
