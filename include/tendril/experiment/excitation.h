// Identification experiments as planned programs: the targets of a robot over time, within its limits. Pure
// functions of robot, plan and seed; knows nothing of how a program is run or recorded.
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

namespace tendril::experiment {

/// Rest at pretension at the start of every program.
inline constexpr double kStillBefore_s = 0.5;

/// Corner of a user's piecewise-linear program
struct Waypoint {
  double t_s = 0;  // after the initial rest
  std::vector<double> value;
};

/// One experiment of a plan.
struct PlannedRun {
  std::string family;
  double amplitude_rad = 0;  // requested bend of the whole robot; reduced where tensions limit it
  double duration_s = 0;     // of the recorded run, including the initial rest
  int repeats = 0;           // identical repetitions in addition to the run itself
  std::uint64_t seed = 1;    // of the multisine's phases
  enum class Targets { kFamily, kBending, kTension } targets = Targets::kFamily;
  std::vector<Waypoint> waypoints;  // empty for a known family
  std::string where{};              // "plan.yaml:3"; empty for built-in plans
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
/// With comments, for editing; parsing it restores the same plan.
std::string ToYaml(const Plan& plan);

/// Targets on a uniform time grid: initial rest, the experiment, and the return to straight at the minimum
/// tension.
struct Program {
  std::string family;
  bool tension = false;  // targets are tensions at the base (S x M), else bending (S x 2K)
  double step_s = 0;
  double speed_radps = 0;  // speed at which the controller may approach a bending target
  Eigen::MatrixXd targets;
  double duration_s() const { return step_s * static_cast<double>(targets.rows()); }
  /// Active target at time t, as a command without sequence and validity. During the initial rest there is
  /// none: kind kNone.
  Command At(double t_s) const;
};

/// Plans a run for a robot, given the limits of the controller that will run it. Bends are reduced so that
/// the tensions of the controller's model stay below three quarters of the robot's limit. Throws
/// std::invalid_argument with the remedy for a run that cannot stay within the limits.
Program MakeProgram(const PlannedRun& run, const RobotParameters& robot,
                    const ControllerParameters& controller);

}  // namespace tendril::experiment
