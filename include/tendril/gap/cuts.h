// Which cuts of the chain a data set allows to be compared, from its channels alone. Simulates nothing.
#pragma once

#include <string>
#include <vector>

#include "tendril/gap/data_set.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

/// One of the cuts C0 to C6 in a data set.
struct CutOfSet {
  sim::Cut cut{};
  /// Channels that are missing for this cut, such as "actual torque and motor position"; empty where at least
  /// one run has all of them.
  std::string lacks;
  /// Tendons, counted from 1, for which no run has these channels; empty where none is missing, or where the
  /// cut is not one of single tendons.
  std::vector<int> without;
  /// Only beside runs from before a change, from which such a robot is learned: its motors hold positions.
  bool with_before = false;

  bool allowed() const { return lacks.empty(); }
};

/// C0 to C6 in order.
std::vector<CutOfSet> CutsOf(const DataSet& set);

/// True where any cut can be compared besides the time stamps (C0), alone or with runs from before.
bool AnyCut(const std::vector<CutOfSet>& cuts);

/// One line: "can be compared: C0, C4; not C1 (no target torque), ...".
std::string CutsLine(const std::vector<CutOfSet>& cuts);

}  // namespace tendril::gap
