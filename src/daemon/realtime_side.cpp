#include "realtime_side.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdio>
#include <utility>

namespace tendril::daemon {
namespace {

constexpr int kEventsPerCycle = 16;

// After the stop request: time for tensions to ramp down, then for the drives to be disabled. The rest of the
// 2 s is for joining the thread and closing the log.
constexpr TimeNs kDisarmWithin_ns = 1200 * kNsPerMs;
constexpr TimeNs kStopWithin_ns = 1850 * kNsPerMs;

// A command thread that stalls this long cannot receive a disarm either.
constexpr TimeNs kUnattended_ns = kNsPerS;

}  // namespace

RealtimeSide::RealtimeSide(const DaemonOptions& options, can::CanPort& port, rt::Timebase& time,
                           const std::vector<canopen::DriveSetup>& setups, Handover& handover)
    : options_(options),
      time_(time),
      clock_(time.clock()),
      port_(port),
      handover_(handover),
      master_(options.parameters.bus, setups, port),
      controller_(options.robot, options.parameters.controller, options.parameters.bus.cycle_ns),
      cycle_(controller_, master_, clock_, options.robot, options.parameters.bus, [this](TimeNs deadline_ns) {
        return usage_.Excuse([&] { return port_.WaitUntil(deadline_ns); });
      }) {}

void RealtimeSide::Run(std::promise<std::string>& ready) {
  const DaemonParameters& p = options_.parameters;
  const std::string problems = time_.Enter(p.realtime);
  const bool refused = !problems.empty() && p.realtime.required;
  if (!refused) master_.Start(clock_.Now());
  ready.set_value(problems);
  if (refused) return;
  time_.Run(p.bus.cycle_ns, [this](const rt::CycleStart& start) { return Tick(start); });
  handover_.finished.store(true, std::memory_order_release);
}

bool RealtimeSide::Tick(const rt::CycleStart& start) {
  const TimeNs now_ns = clock_.Now();
  if (phase_ == Phase::kRunning && handover_.stop_requested.load(std::memory_order_relaxed)) {
    phase_ = Phase::kDisarming;
    stop_ns_ = now_ns;
    disarm_pending_ = true;
  }
  if (phase_ == Phase::kShutdown) return ShutDown(start, now_ns);

  usage_.Begin();
  cycle_.Run(start, NextCommand(now_ns), NextTrackerSample(), published_.record);
  HandOver(start);
  usage_.End();

  if (phase_ == Phase::kDisarming && !disarm_pending_) {
    const bool in_time = clock_.Now() < stop_ns_ + kDisarmWithin_ns;
    if (!in_time || AllDisabled()) {
      handover_.disarmed_in_time.store(in_time, std::memory_order_relaxed);
      phase_ = Phase::kShutdown;
    }
  }
  return true;
}

bool RealtimeSide::ShutDown(const rt::CycleStart& start, TimeNs now_ns) {
  master_.Poll(now_ns);
  const bool done = master_.Shutdown(now_ns);
  ForwardEvents();
  handover_.tick.store(start.cycle + 1, std::memory_order_relaxed);
  return !done && now_ns < stop_ns_ + kStopWithin_ns;
}

void RealtimeSide::HandOver(const rt::CycleStart& start) {
  published_.can = port_.counters();
  published_.frame_faults = master_.frame_faults();
  published_.usage = usage_.sum();  // up to the previous cycle
  for (int i = 0; i < master_.drives(); ++i)
    published_.serials[static_cast<std::size_t>(i)] = master_.serial(i);
  handover_.records.TryPush(published_);
  if (black_box_ != nullptr) black_box_->Add(published_.record, controller_);
  ForwardEvents();
  handover_.tick.store(start.cycle + 1, std::memory_order_relaxed);
}

Command RealtimeSide::NextCommand(TimeNs now_ns) {
  Command command;
  if (phase_ == Phase::kDisarming) {
    if (!disarm_pending_) return command;
    // The daemon's own command passes the gate like any other, so that the log explains the stop.
    disarm_pending_ = false;
    command.kind = CommandKind::kMode;
    command.mode = ModeRequest::kStop;
  } else if (handover_.disarm_waits.exchange(false, std::memory_order_relaxed)) {
    command.mode = ModeRequest::kDisarm;
  } else if (CommandThreadStalled()) {
    command.mode = ModeRequest::kDisarm;
    canopen::BusEvent event{.time_ns = now_ns, .status = Status::kUnattended};
    std::snprintf(event.text.data(), event.text.size(), "%s", StatusText(Status::kUnattended).data());
    handover_.events.TryPush(event);
  } else {
    if (!handover_.stops.TryPop(command) && handover_.commands.TryPop(command)) DropOvertaken(command);
    if (command.kind != CommandKind::kNone) last_sequence_ = command.sequence;
    return command;
  }
  command.kind = CommandKind::kMode;
  command.sequence = last_sequence_ + 1;
  command.received_ns = now_ns;
  command.valid_for_ns = kNsPerS;
  return command;
}

// Of several waiting targets the last one counts.
void RealtimeSide::DropOvertaken(Command& command) {
  while (command.kind != CommandKind::kMode) {
    const Command* next = handover_.commands.Peek();
    if (next == nullptr || next->kind != command.kind || next->sender != command.sender) return;
    handover_.commands.TryPop(command);
    handover_.overtaken.fetch_add(1, std::memory_order_relaxed);
  }
}

// True once each time the other thread stalls while drives are on.
bool RealtimeSide::CommandThreadStalled() {
  if (machine_.Now() - handover_.served_ns.load(std::memory_order_relaxed) < kUnattended_ns) {
    left_alone_ = false;
    return false;
  }
  const CycleOutput& out = published_.record.output;
  const bool pulls =
      out.drive_request == DriveRequest::kEnable && out.mode != Mode::kSafeStop && out.mode != Mode::kFault;
  return pulls && !std::exchange(left_alone_, true);
}

TrackerSample RealtimeSide::NextTrackerSample() {
  TrackerSample sample;
  handover_.tracker.TryPop(sample);
  return sample;
}

bool RealtimeSide::AllDisabled() const {
  const CycleRecord& record = published_.record;
  if (record.output.drive_request == DriveRequest::kEnable) return false;
  return std::none_of(record.input.drive.begin(), record.input.drive.begin() + record.input.drives,
                      [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
}

void RealtimeSide::ForwardEvents() {
  canopen::BusEvent event;
  for (int i = 0; i < kEventsPerCycle && master_.PopEvent(&event); ++i) handover_.events.TryPush(event);
  handover_.master_events_lost.store(master_.events_lost(), std::memory_order_relaxed);
}

}  // namespace tendril::daemon
