// Identification experiments as planned programs: which targets a robot is sent, when, within its limits.
// Pure functions of robot, plan and seed; knows nothing of how a program is run or recorded.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::tools {

/// Stillness at pretension with which every program begins.
inline constexpr double kStillBefore_s = 0.5;

/// Corner of a piecewise-linear program of one's own; `value` is (us, vs) per section [rad] or tensions at
/// the base [N].
struct Waypoint {
  double t_s = 0;  // after the stillness
  std::vector<double> value;
};

/// One experiment as a plan lists it.
struct PlannedRun {
  std::string family;
  double amplitude_rad = 0;  // bend of the whole robot asked for; less where the tensions would not allow it
  double duration_s = 0;     // of the recorded run, stillness included
  int repeats = 0;           // identical repetitions beside the run itself
  std::uint64_t seed = 1;    // of the multisine's phases
  enum class Targets { kFamily, kBending, kTension } targets = Targets::kFamily;
  std::vector<Waypoint> waypoints;  // empty for a family that is known
  std::string where{};              // "plan.yaml:3"; empty for what comes with Tendril
};

struct Plan {
  std::string name;
  std::vector<PlannedRun> runs;
};

/// "triangle", "cocontraction", "circle", "steps", "multisine", "ladder", "hold", "sway".
std::span<const std::string_view> Families();
/// A run of this family with its usual amplitude and duration. Throws std::invalid_argument for any other.
PlannedRun UsualRun(std::string_view family);

/// About 150 s of data; triangle and circle twice.
Plan StandardPlan();
/// About 60 s; sway twice.
Plan QuickPlan();
/// "standard" or "quick"; throws std::invalid_argument naming them.
Plan NamedPlan(const std::string& name);

/// Strict YAML, errors as those of robot files: std::runtime_error with file, line, key, accepted range and
/// remedy.
Plan LoadPlan(const std::string& path);
Plan ParsePlan(const std::string& yaml, const std::string& name_for_errors);
/// With comments, ready to be edited; parsing it gives the same plan again.
std::string ToYaml(const Plan& plan);

/// Targets on a uniform grid of time: stillness, the experiment, straight at the least tension again.
struct Program {
  std::string family;
  bool tension = false;  // targets are tensions at the base (S x M), else bending (S x 2K)
  double step_s = 0;
  double speed_radps = 0;  // at which the controller may close in on a bending target
  Eigen::MatrixXd targets;
  double duration_s() const { return step_s * static_cast<double>(targets.rows()); }
  /// Target in force at time t, a command that still lacks its sequence and validity. During the stillness
  /// there is none: kind kNone.
  Command At(double t_s) const;
};

/// Plans a run for a robot, given the limits of the controller that will run it. Bends are reduced to what
/// keeps the tensions that the controller's model needs below three quarters of the robot's limit. Throws
/// std::invalid_argument, naming what to change, for a run that cannot be kept within the limits.
Program MakeProgram(const PlannedRun& run, const RobotParameters& robot,
                    const ControllerParameters& controller);

}  // namespace tendril::tools
