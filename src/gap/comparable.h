// Makes the runs of a set comparable before they are prepared. Knows nothing of models.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tendril/gap/data_set.h"

namespace tendril::gap {

/// True where some runs are compared with runs from before the robot changed.
bool Compared(const DataSet& set);

/// Removes a run; its repetitions then repeat the first of them.
void LeaveOut(DataSet& set, std::size_t run);

/// Throws where a run has another number of tendons than the robot.
void RequireTendons(const DataSet& set);

/// Leaves out runs that are too short, so that the others can be diagnosed; returns one line for each. Throws
/// std::runtime_error when no run is left.
std::vector<std::string> LeaveOutShortRuns(DataSet& set);

/// Units that the time column may be in by mistake.
struct TimeUnit {
  double seconds;
  const char* name;
};
inline constexpr TimeUnit kTimeUnits[] = {
    {1e-3, "milliseconds"}, {1e-6, "microseconds"}, {1e-9, "nanoseconds"}};

/// True where motors move smoothly from row to row, as in a recorded motion and unlike a list of states at
/// rest.
bool Smooth(const Run& run);

/// Removes runs whose time is in another unit than that of the others; returns one line for each.
std::vector<std::string> LeaveOutOtherTimeUnits(DataSet& set);

/// Gives every run columns for all tendons in each kind of drive or cell signal that any run has; columns
/// without data hold NaN. A run declared without load cell has no tensions, whatever its columns hold.
void FillMissing(DataSet& set);

}  // namespace tendril::gap
