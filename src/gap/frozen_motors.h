// Motor positions that keep one value while the motor turns. Knows no other sensor faults.
#pragma once

#include <cstddef>
#include <vector>

#include "evaluator.h"
#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Rows [from, to) of a run in which a motor position keeps one value although the motor turned: its tension
/// contradicts the stretch of a tendon whose motor stands still, and it changes, here or in another such
/// stretch.
struct FrozenMotor {
  std::size_t run = 0;
  Eigen::Index tendon = 0, from = 0, to = 0;
  double tension_N = 0;  // change of the tension
};

/// For sets compared with runs from before, where errors of the stretch cancel: motors that stand still
/// throughout a run while their tension changes by more than friction can hold.
std::vector<FrozenMotor> FindFrozenMotors(const DataSet& set, const Evaluator& evaluator);

}  // namespace tendril::gap
