// Whether the tracker and the drives share a clock, and if not, by how much they differ. Knows no effects.
#pragma once

#include <string>
#include <vector>

#include "prepare.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {

struct TrackerClocks {
  std::vector<double> late_s;  // of each run: how late its tracker readings are stamped, to within some ms
  std::string note;            // the evidence; empty, and all of late_s 0, where the clocks may be the same
};

/// Compares each run with the motion that the nominal robot makes of its tensions (`motions`, as reported:
/// with the delay `file_delay_s` that the robot file gives the tracker). A delay shared by all runs may
/// belong to the robot or the tracker and is left to the search. The clocks differ where no robot can be the
/// reason: the tip moves before the motors, a repetition has another delay than its original, or runs differ
/// in their delay and in nothing else.
TrackerClocks CompareClocks(const std::vector<PreparedRun>& runs, const std::vector<sim::BodyMotion>& motions,
                            double file_delay_s);

}  // namespace tendril::gap
