// A closed loop led through a planned motion, as an operator's program would lead a robot: streamed moving
// targets. Knows nothing of what is made of the run.
#pragma once

#include <functional>

#include "closed_loop.h"
#include "motion.h"

namespace tendril::tools {

/// Called after every cycle with the motion's time of the target that was in force in it [s].
using CycleObserver = std::function<void(const CycleRecord& record, double target_s)>;

/// From a running, armed loop to the motion's first target, until the robot has come to rest there; throws
/// std::runtime_error when that takes longer than 30 s of simulated time. target_s is 0.
void ApproachStart(ClosedLoop& loop, const Motion& motion, const CycleObserver& observe);

/// Streams the motion from beginning to end, one command every 10 ms.
/// `ahead_s`: each target is sent this long before its time, for a controller that does not look ahead
/// itself.
void StreamMotion(ClosedLoop& loop, const Motion& motion, const CycleObserver& observe, double ahead_s = 0);

/// Number of cycles nearest to a period, at least one.
std::uint64_t CyclesOf(const ClosedLoop& loop, double period_s);

}  // namespace tendril::tools
