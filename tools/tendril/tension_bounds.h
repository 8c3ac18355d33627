// --min-tension, and the bounds of tensions with it. Knows the command line and the robot's limits only.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "tendril/core/robot.h"
#include "tendril/core/usage_error.h"

namespace tendril::tools {

struct TensionBounds {
  double low_N, high_N;
};

class MinTensionOption {
 public:
  void AddTo(CLI::App& command) {
    option_ = command.add_option("--min-tension", min_tension_N_,
                                 "least tension [N] of every tendon with a motor of its own (default: "
                                 "limits.min_tension_N of the robot file; the upper bound is its "
                                 "limits.max_tension_base_N)");
  }
  /// Throws UsageError where none is left.
  TensionBounds BoundsOf(const RobotParameters& robot) const {
    const double low_N = *option_ ? min_tension_N_ : robot.limits.min_tension_N;
    const double high_N = robot.limits.max_tension_base_N;
    if (!(low_N >= 0 && low_N <= high_N)) {
      throw UsageError(
          fmt::format("--min-tension = {} N: accepted 0 .. {} N (limits.max_tension_base_N of the robot)",
                      low_N, high_N));
    }
    return {low_N, high_N};
  }

 private:
  double min_tension_N_ = 0;
  CLI::Option* option_ = nullptr;
};

}  // namespace tendril::tools
