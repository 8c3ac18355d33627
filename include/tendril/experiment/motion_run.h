// Runs a planned motion on a closed loop, with streamed moving targets as an operator's program sends them.
// Knows nothing of the use of the run.
#pragma once

#include <functional>

#include "tendril/experiment/closed_loop.h"
#include "tendril/motion/motion.h"

namespace tendril::experiment {

/// Called after every cycle with the motion time of the target active in it [s].
using CycleObserver = std::function<void(const CycleRecord& record, double target_s)>;

/// Moves a running, armed loop to the motion's first target and waits until the robot is at rest there;
/// throws std::runtime_error after 30 s of simulated time. target_s is 0.
void ApproachStart(ClosedLoop& loop, const motion::Motion& motion, const CycleObserver& observe);

/// Streams the motion from beginning to end, one command every 10 ms. `ahead_s`: each target is sent this
/// long before its time, for a controller without look-ahead.
void StreamMotion(ClosedLoop& loop, const motion::Motion& motion, const CycleObserver& observe,
                  double ahead_s = 0);

/// Number of cycles nearest to a period, at least one.
std::uint64_t CyclesOf(const ClosedLoop& loop, double period_s);

}  // namespace tendril::experiment
