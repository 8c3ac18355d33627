// Measurement errors that look like a gap larger than any effect makes: a sign, an order, a side, a unit, a
// delay. Knows how each is undone, nothing of what that does to a gap.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

struct Mistake {
  std::string with;                    // the correction, as a phrase that follows "with"
  std::function<void(Run&)> in_run{};  // undoes it in each run, and in the robot file
  std::vector<Mistake> finer{};        // the same error with sizes near this one's
  std::function<void(RobotParameters&)> in_file{};

  void Undo(DataSet& set) const {
    for (Run& run : set.runs) {
      if (in_run) in_run(run);
    }
    if (in_file) in_file(set.robot);
  }
};

/// The sensors of these runs that an error can concern.
struct Measured {
  bool cells = false, tracker = false;
  int disagreeing_cell = -1;  // tendon whose load cell disagrees far more than the others; -1: none
};

/// Errors that may concern one run as well as all of them.
std::vector<Mistake> MistakesOfReading(const DataSet& set, Measured measured);
/// Errors in what is declared for all runs.
std::vector<Mistake> AllMistakes(const DataSet& set, Measured measured);

/// A load cell whose zero is off by this much.
Mistake MovedZero(int tendon, double zero_N);

}  // namespace tendril::gap
