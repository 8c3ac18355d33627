#include "tendril/experiment/motion_run.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tendril::experiment {
namespace {

// A robot closer than this to the motion's first target has arrived.
constexpr double kArrivedBending_rad = 1e-4;
constexpr double kRest_s = 0.5, kApproachTimeout_s = 30;
constexpr double kCommandPeriod_s = 0.01;

}  // namespace

std::uint64_t CyclesOf(const ClosedLoop& loop, double period_s) {
  const double cycles = period_s * 1e9 / static_cast<double>(loop.cycle_ns());
  return std::max<std::uint64_t>(1, static_cast<std::uint64_t>(std::llround(cycles)));
}

void ApproachStart(ClosedLoop& loop, const motion::Motion& motion, const CycleObserver& observe) {
  loop.Send(motion.Start());
  const double end_s = loop.now_s() + kApproachTimeout_s;
  for (double still_since_s = loop.now_s(); loop.now_s() - still_since_s < kRest_s;) {
    const CycleRecord& r = loop.Step();
    observe(r, 0);
    const double gap_rad = (r.output.reference.position_rad - r.output.target_bending_rad).norm();
    if (gap_rad > kArrivedBending_rad) still_since_s = loop.now_s();
    if (loop.now_s() > end_s) throw std::runtime_error("the motion's first target was not reached in 30 s");
  }
}

void StreamMotion(ClosedLoop& loop, const motion::Motion& motion, const CycleObserver& observe,
                  double ahead_s) {
  const std::uint64_t command_every = CyclesOf(loop, kCommandPeriod_s);
  const TimeNs start_ns = loop.now_ns();
  for (std::uint64_t step = 0; ToSeconds(loop.now_ns() - start_ns) < motion.duration_s(); ++step) {
    // The command sent before a cycle is the target of that cycle, so the motion's clock starts with it.
    const double target_s = ToSeconds(loop.now_ns() - start_ns);
    if (step % command_every == 0) loop.Send(motion.At(std::min(target_s + ahead_s, motion.duration_s())));
    observe(loop.Step(), target_s);
  }
}

}  // namespace tendril::experiment
