// How a robot does not repeat, as plain data. Knows nothing of how it was found.
#pragma once

#include <string>

#include "tendril/sim/effects.h"

namespace tendril::gap {

/// Runs that differ from their repetitions by far more than the sensors explain, or by as much as follows a
/// state, at the place where that shows most: the robot does something that its model has not, or was
/// changed.
struct Repeatability {
  sim::Cut cut{};
  std::string where, quantity, unit;  // as in CutFinding
  double rms = 0;                     // by which each of two runs is off what they have in common
  double floor = 0;                   // what the sensors leave of that
  double sigma = 0;                   // sqrt(rms^2 - floor^2) / floor, each window by its own floor
  std::string depends_on;  // "the angle of motor 2, 3 times a turn"; empty: no state that was tried
  double p_value = 1;      // of chance making as much of any state that was tried
  bool law = false;        // the difference itself follows the state; else its size alone, or nothing does
};

}  // namespace tendril::gap
