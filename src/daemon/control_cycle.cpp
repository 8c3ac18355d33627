// One control cycle; see the header.
#include "tendril/daemon/control_cycle.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>

namespace tendril::daemon {
namespace {

// Bounds the polls, so that a flooded bus cannot prevent the cycle from ending.
constexpr int kMaxPolls = 1000;

std::int16_t Turned(std::int16_t value) noexcept {
  return static_cast<std::int16_t>(-std::max<int>(value, -std::numeric_limits<std::int16_t>::max()));
}
// Modulo 2^32, as the drive counts.
std::int32_t Turned(std::int32_t counts) noexcept {
  return static_cast<std::int32_t>(0u - static_cast<std::uint32_t>(counts));
}

}  // namespace

ControlCycle::ControlCycle(control::Controller& controller, canopen::Master& master, const Clock& clock,
                           const BusParameters& bus, Wait wait)
    : controller_(controller),
      master_(master),
      clock_(clock),
      feedback_deadline_ns_(bus.feedback_deadline_ns),
      wait_(std::move(wait)) {
  for (const NodeParameters& node : bus.nodes) {
    const auto j = static_cast<std::size_t>(node.tendon - 1);
    motor_reversed_[j] = node.motor_reversed;
    encoder_reversed_[j] = node.encoder_reversed;
  }
}

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
  const bool unreachable = master_.interface_down();
  for (int i = 0; i < input.drives; ++i) {
    const auto j = static_cast<std::size_t>(i);
    DriveFeedback& drive = input.drive[j];
    drive = master_.feedback(i);
    if (unreachable) drive.state = DriveState::kUnreachable;
    if (motor_reversed_[j]) drive.torque_permille = Turned(drive.torque_permille);
    if (encoder_reversed_[j]) drive.position_counts = Turned(drive.position_counts);
  }
  input.command = command;
  input.tracker = tracker;

  const TimeNs before_ns = clock_.Now();
  controller_.Step(input, output);
  const TimeNs after_ns = clock_.Now();

  if (output.clear_drive_faults) master_.ClearFaults(after_ns);
  auto torque_permille = output.torque_target_permille;
  for (std::size_t j = 0; j < static_cast<std::size_t>(input.drives); ++j) {
    if (motor_reversed_[j]) torque_permille[j] = Turned(torque_permille[j]);
  }
  master_.EndCycle(after_ns, output.drive_request,
                   std::span(torque_permille).first(static_cast<std::size_t>(input.drives)));

  CycleTiming& timing = record.timing;
  timing.wake_latency_ns = start.wake_latency_ns;
  timing.feedback_ns = feedback_ns;
  timing.compute_ns = after_ns - before_ns;
  timing.total_ns = clock_.Now() - (start.grid_ns + start.wake_latency_ns);
  timing.deadline_misses = deadline_misses_;
}

}  // namespace tendril::daemon
