// Which cuts of the chain the channels of a data set allow to compare, before anything is simulated.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// One cut, C0 to C6, of a set.
struct CutOfSet {
  sim::Cut cut{};
  /// The channels that it still needs, such as "actual torque and motor position"; empty where some run has
  /// all.
  std::string lacks;
  /// Tendons, from 1, for which no run has them; empty where all have, or where the cut has no tendons.
  std::vector<int> without;

  bool allowed() const { return lacks.empty(); }
};

/// C0 to C6 in order.
std::vector<CutOfSet> CutsOf(const DataSet& set);

/// True when anything but the time stamps (C0) can be compared.
bool AnyCut(const std::vector<CutOfSet>& cuts);

/// One line: "can be compared: C0, C4; not C1 (no target torque), ...".
std::string CutsLine(const std::vector<CutOfSet>& cuts);

}  // namespace tendril::gap
