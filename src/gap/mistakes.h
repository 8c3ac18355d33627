// Mistakes in how a robot was measured that look like a gap larger than any effect makes: a sign, an order, a
// side, a unit, a delay. Knows how each is undone, nothing of what it does to a gap.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

struct Mistake {
  std::string with;                    // what would make it right, as words that follow "with"
  std::function<void(Run&)> in_run{};  // how it is undone in each run, and in the robot file
  std::vector<Mistake> finer{};        // of other sizes about this one's
  std::function<void(RobotParameters&)> in_file{};

  void Undo(DataSet& set) const {
    for (Run& run : set.runs) {
      if (in_run) in_run(run);
    }
    if (in_file) in_file(set.robot);
  }
};

/// What of these runs' sensors it can have been made with.
struct Measured {
  bool cells = false, tracker = false;
  int odd_cell = -1;  // tendon whose load cell disagrees far more than the others'; -1: none
};

/// What may go wrong in recording one run as well as all of them.
std::vector<Mistake> MistakesOfReading(const DataSet& set, Measured measured);
/// And in what is said of all of them.
std::vector<Mistake> AllMistakes(const DataSet& set, Measured measured);

/// A load cell whose zero is off by so much.
Mistake MovedZero(int tendon, double zero_N);

}  // namespace tendril::gap
