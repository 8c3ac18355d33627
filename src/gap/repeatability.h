// How far runs differ from their repetitions beyond what the sensors explain, and what that depends on. What
// a robot does not repeat is no noise where it follows a state that each run reaches otherwise: friction that
// peaks at angles, detents. Knows nothing of causes and verdicts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tendril/gap/repeatability.h"

namespace tendril::gap {

class Evaluator;

/// How a channel differs between runs of the same commands, over `windows` that both of each two have.
struct Repeated {
  double square = 0,
         noise = 0;  // half the mean square difference, and what the channel's variance makes of it
  double ratio = 0;  // mean of the one over the other, window by window
  int windows = 0;

  /// Enough of them to know how it repeats.
  bool known() const { return windows > 20; }
};
Repeated RepeatedIn(const Evaluator& evaluator, int channel);

/// Indices of runs of the same commands, two or more, the one that others repeat first.
std::vector<std::vector<int>> RepeatedRuns(const Evaluator& evaluator);

struct RepeatabilityOptions {
  std::uint64_t seed = 1;
  double delta_N = 0, delta_m = 0;  // what differs by less is nobody's concern; 0: by the floor
};

/// Of the place that differs most, among those that follow a state where any does; nothing where runs repeat
/// as well as robots do, or none is repeated. `evaluator`: its variances are still those of the sensors
/// alone.
std::optional<Repeatability> FindRepeatability(const Evaluator& evaluator,
                                               const RepeatabilityOptions& options);

/// What is to be said where no place has a gap, and what is added where one has; nothing where runs repeat.
std::string Unrepeated(const Repeatability& repeatability);
std::string ButUnrepeated(const std::optional<Repeatability>& repeatability);

/// Probability that nothing but chance makes these runs differ as they do.
double ChanceOf(const Repeatability& repeatability);

}  // namespace tendril::gap
