// Runs of one set made comparable before they are prepared. Knows nothing of models.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// Some runs are compared with others from before the robot changed.
bool Compared(const DataSet& set);

/// Takes a run out; what repeated it repeats the first of its repetitions now.
void LeaveOut(DataSet& set, std::size_t run);

/// Units that time may be in by mistake.
struct TimeUnit {
  double seconds;
  const char* name;
};
inline constexpr TimeUnit kTimeUnits[] = {
    {1e-3, "milliseconds"}, {1e-6, "microseconds"}, {1e-9, "nanoseconds"}};

/// Motors go smoothly from row to row: a motion, as states that were waited for are not.
bool Smooth(const Run& run);

/// Takes out runs whose time is in another unit than the others'; a line for each.
std::vector<std::string> TakeOutOtherTime(DataSet& set);

/// Gives every run the columns of drives and cells that any of them has for all of the robot's tendons,
/// without values, so that what one run lacks leaves the others theirs. A run declared without load cell has
/// none, whatever its columns hold.
void FillMissing(DataSet& set);

}  // namespace tendril::gap
