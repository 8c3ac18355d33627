// One control cycle; see the header.
#include "tendril/daemon/control_cycle.h"

#include <span>
#include <utility>

namespace tendril::daemon {
namespace {

// A bus that babbles must not keep the cycle from ending.
constexpr int kMaxPolls = 1000;

}  // namespace

ControlCycle::ControlCycle(control::Controller& controller, canopen::Master& master, const Clock& clock,
                           const BusParameters& bus, Wait wait)
    : controller_(controller),
      master_(master),
      clock_(clock),
      feedback_deadline_ns_(bus.feedback_deadline_ns),
      wait_(std::move(wait)) {}

void ControlCycle::Run(const rt::CycleStart& start, const Command& command, const TrackerSample& tracker,
                       CycleRecord& record) noexcept {
  CycleInput& input = record.input;
  CycleOutput& output = record.output;

  const TimeNs sync_ns = clock_.Now();
  master_.BeginCycle(sync_ns);
  const TimeNs deadline_ns = sync_ns + feedback_deadline_ns_;
  TimeNs now_ns = sync_ns;
  bool complete = false;
  for (int i = 0; i < kMaxPolls && !complete && now_ns < deadline_ns; ++i) {
    const bool more = wait_(deadline_ns);
    now_ns = clock_.Now();
    complete = master_.Poll(now_ns);
    if (!more) break;
  }
  const TimeNs feedback_ns = now_ns - sync_ns;

  deadline_misses_ += start.missed;
  input.cycle = start.cycle;
  input.time_ns = start.grid_ns;
  input.bus_ok = master_.bus_ok();
  input.late = start.missed > 0;
  input.drives = master_.drives();
  for (int i = 0; i < input.drives; ++i) input.drive[static_cast<std::size_t>(i)] = master_.feedback(i);
  input.command = command;
  input.tracker = tracker;

  const TimeNs before_ns = clock_.Now();
  controller_.Step(input, output);
  const TimeNs after_ns = clock_.Now();

  if (output.clear_drive_faults) master_.ClearFaults(after_ns);
  master_.EndCycle(after_ns, output.drive_request,
                   std::span(output.torque_target_permille).first(static_cast<std::size_t>(input.drives)));

  CycleTiming& timing = record.timing;
  timing.wake_latency_ns = start.wake_latency_ns;
  timing.feedback_ns = feedback_ns;
  timing.compute_ns = after_ns - before_ns;
  timing.total_ns = clock_.Now() - (start.grid_ns + start.wake_latency_ns);
  timing.deadline_misses = deadline_misses_;
}

}  // namespace tendril::daemon
