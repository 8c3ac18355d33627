// Whether a tracker's time stamps are of the drives' clock, and by how much they are not. Knows no effects.
#pragma once

#include <string>
#include <vector>

#include "prepare.h"
#include "tendril/sim/replay.h"

namespace tendril::gap {

struct TrackerClocks {
  std::vector<double> late_s;  // of each run: its readings are stamped so much too late, to some ms
  std::string note;  // what was found; empty, and all of late_s 0, when nothing speaks against the clocks
};

/// From the motion that the nominal robot makes of each run's tensions (`motions`, as reported: with the
/// delay `told_s` that the robot file gives the tracker). A delay that all runs share may be the robot's or
/// the tracker's own, and is left to the search; clocks differ where no robot can be the reason: the tip
/// moves before the motors, a repetition is late by another time than its original, or the runs are off by
/// different times and by nothing else.
TrackerClocks CompareClocks(const std::vector<PreparedRun>& runs, const std::vector<sim::BodyMotion>& motions,
                            double told_s);

}  // namespace tendril::gap
