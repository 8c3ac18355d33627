// Whether two runs have the same commands, by the signals that both recorded. Knows nothing of models.
#pragma once

#include <string>
#include <vector>

#include "prepare.h"

namespace tendril::gap {

/// One kind of signal compared between two runs.
struct SignalCompared {
  const char* name;  // "torque targets", "motor positions", ...
  const char* unit;  // "N·m", "rad", "N", "m"
  double rms = 0;    // difference of the worst motor (axis)
  double share = 0;  // of the rms difference of two unrelated motions of this kind; 1: unrelated
};

/// The signals that indicate the commands: torque targets where both runs have them, else everything that a
/// controller may follow or cause: actual torques, motor positions, tensions, tip.
struct CommandsCompared {
  std::vector<SignalCompared> by;  // by rising share; empty: no common signal moves beyond its noise

  /// One matching signal is enough: a changed robot responds differently to the same commands, and a motor
  /// with another zero reports other positions, but not in every signal.
  bool same() const { return by.empty() || by.front().share <= kSame; }
  /// "torque targets differ by 0.0012 N·m rms (140 %), ...", all of them or only the best match.
  std::string Text(bool all) const;

  /// Half way between the same motion and an unrelated one: a correlation of 0.75.
  static constexpr double kSame = 0.5;
};

CommandsCompared CompareCommands(const PreparedRun& run, const PreparedRun& before);

}  // namespace tendril::gap
