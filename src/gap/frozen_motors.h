// Motor positions that keep one value while the motor turns. Knows nothing of mistakes of other kinds.
#pragma once

#include <cstddef>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Rows [from, to) of a run in which a motor position keeps one value though the motor turned: its tension is
/// not what the tendon's stretch says of a motor that stands, and changes, there or in another such stretch.
struct FrozenMotor {
  std::size_t run = 0;
  Eigen::Index tendon = 0, from = 0, to = 0;
  double tension_N = 0;  // by which it changes
};

/// In sets that compare with runs from before, where stretch says nothing of what both have wrong: motors
/// that stand throughout a run while their tension changes by more than friction holds.
std::vector<FrozenMotor> FindFrozenMotors(const DataSet& set, const Evaluator& evaluator);

}  // namespace tendril::gap
