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
                           const RobotParameters& robot, const BusParameters& bus, Wait wait)
    : controller_(controller),
      master_(master),
      clock_(clock),
      feedback_deadline_ns_(bus.feedback_deadline_ns),
      wait_(std::move(wait)) {
  const ActuationParameters& actuation = robot.actuation.value();
  for (const NodeParameters& node : bus.nodes) {
    const auto i = static_cast<std::size_t>(actuation.DriveOf(node.tendon - 1));
    motor_reversed_[i] = node.motor_reversed;
    encoder_reversed_[i] = node.encoder_reversed;
  }
  for (int j = 0; j < robot.body.tendons(); ++j)
    tendons_.push_back({static_cast<std::size_t>(actuation.DriveOf(j)), !actuation.HasDrive(j)});
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
  input.drives = static_cast<int>(tendons_.size());
  const bool unreachable = master_.interface_down();
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    const auto [i, turned] = tendons_[j];
    DriveFeedback& drive = input.drive[j];
    drive = master_.feedback(static_cast<int>(i));
    if (unreachable) drive.state = DriveState::kUnreachable;
    if (motor_reversed_[i] != turned) drive.torque_permille = Turned(drive.torque_permille);
    if (encoder_reversed_[i] != turned) drive.position_counts = Turned(drive.position_counts);
  }
  input.command = command;
  input.tracker = tracker;

  const TimeNs before_ns = clock_.Now();
  controller_.Step(input, output);
  const TimeNs after_ns = clock_.Now();

  if (output.clear_drive_faults) master_.ClearFaults(after_ns);
  std::array<std::int16_t, kMaxTendons> torque_permille{};  // by drive
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    const auto [i, turned] = tendons_[j];
    const std::int16_t permille = output.torque_target_permille[j];
    if (!turned) torque_permille[i] = motor_reversed_[i] ? Turned(permille) : permille;
  }
  master_.EndCycle(after_ns, output.drive_request,
                   std::span(torque_permille).first(static_cast<std::size_t>(master_.drives())));

  CycleTiming& timing = record.timing;
  timing.wake_latency_ns = start.wake_latency_ns;
  timing.feedback_ns = feedback_ns;
  timing.compute_ns = after_ns - before_ns;
  timing.total_ns = clock_.Now() - (start.grid_ns + start.wake_latency_ns);
  timing.deadline_misses = deadline_misses_;
}

}  // namespace tendril::daemon
