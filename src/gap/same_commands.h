// Whether two runs are of the same commands, by what both of them recorded. Knows nothing of models.
#pragma once

#include <string>
#include <vector>

#include "prepare.h"

namespace tendril::gap {

/// One kind of signal of two runs beside each other.
struct SignalCompared {
  const char* name;     // "torque targets", "motor positions", ...
  const char* unit;     // "N·m", "rad", "N", "m"
  double rms = 0;       // by which the worst motor (axis) differs
  double share = 0;     // of the rms by which two unrelated motions like these differ: 1 is another motion
};

/// Which kinds tell of the commands: torque targets where both runs have them, else everything that a
/// controller may follow or what comes of it: actual torques, motor positions, tensions, tip.
struct CommandsCompared {
  std::vector<SignalCompared> by;  // by rising share; empty: nothing that both recorded moves beyond its noise

  /// One kind that goes alike is enough: a robot that changed does otherwise at the same commands, and a motor
  /// with another zero reports other positions, but not in all that was recorded.
  bool same() const { return by.empty() || by.front().share <= kSame; }
  /// "torque targets differ by 0.0012 N·m rms (140 %), ...", all of them or only the one that goes most alike.
  std::string Text(bool all) const;

  /// Half way between the same motion and an unrelated one: correlated by 0.75.
  static constexpr double kSame = 0.5;
};

CommandsCompared CompareCommands(const PreparedRun& run, const PreparedRun& before);

}  // namespace tendril::gap
