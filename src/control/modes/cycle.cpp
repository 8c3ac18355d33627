// What each mode does in a cycle, and when it ends by itself.
#include "../report.h"
#include "modes.h"

namespace tendril::control {
namespace {

// In commissioning, drives are disabled after this time without a pull command.
constexpr TimeNs kUnusedFor_ns = 2 * kNsPerS;
// Time allowed for a tendon to show its minimum tension once that should have settled.
constexpr TimeNs kTautWithin_ns = 2 * kNsPerS;

}  // namespace

void Modes::Supervise(const CycleInput& input, CycleOutput& output, bool entered) noexcept {
  if (input.late) Report(output, Status::kCycleLate);
  const bool was_fault = state_.mode() == Mode::kFault;
  Status fault = Status::kDriveLost;
  if (input.drives == tendons_) {
    const DriveHealth::Commanded commanded{.tension = !stages_.tensions.none(),
                                           .shape = !stages_.reference.tension_commanded()};
    fault = health_.Check(input, commanded, state_, output);
  }
  bool ready = fault == Status::kOk, enabled = ready;
  for (int j = 0; j < tendons_ && j < input.drives; ++j) {
    const DriveState s = input.drive[j].state;
    ready = ready && (s == DriveState::kReady || s == DriveState::kEnabled);
    state_.was_off[j] = state_.was_off[j] || s != DriveState::kEnabled;
    enabled = enabled && state_.was_off[j] && s == DriveState::kEnabled && input.drive[j].age_cycles == 0;
  }

  if (state_.bare && fault == Status::kOk && !was_fault) fault = TakeTendonsUp(input, output);
  if (state_.takes_up() && !state_.engaged && enabled) {
    state_.engaged = state_.bare = true;
    stages_.guards.Restart();
    take_up_.Start(input);
    state_.settled_since_ns = input.time_ns;
  }

  bool changed = fault != Status::kOk && state_.supervisor.Handle(Event::kFault, fault);
  // A mode entered by command in this cycle stays for at least one cycle; only a fault preempts it.
  if (!changed && !entered) changed = Advance(input, output, ready, enabled);
  if (changed) Enter(state_.mode(), input);
  RequestDrives(input, output);
}

// True when the mode ended by itself.
bool Modes::Advance(const CycleInput& input, CycleOutput& output, bool ready, bool enabled) noexcept {
  const Mode mode = state_.mode();
  if (ready && state_.supervisor.Handle(Event::kDrivesReady)) return true;
  if (enabled && state_.supervisor.Handle(Event::kDrivesEnabled)) return true;
  switch (mode) {
    case Mode::kPretension:
      return EndPretension(input, output);
    case Mode::kHoming:
      return EndHoming(input);
    case Mode::kSafeStop:
      return stages_.tensions.Released() && state_.supervisor.Handle(Event::kReleased);
    case Mode::kCommissioning:
      return EndCommissioning(input, output);
    case Mode::kRunning:
      return EndSilentStream(input, output);
    case Mode::kDisconnected:
    case Mode::kConfigured:
    case Mode::kArmed:
    case Mode::kHold:
    case Mode::kFault:
      break;
  }
  return false;
}

bool Modes::EndPretension(const CycleInput& input, CycleOutput& output) noexcept {
  const TimeNs over_settled_ns =
      input.time_ns - state_.settled_since_ns - static_cast<TimeNs>(parameters_.pretension_settle_s * 1e9);
  if (!stages_.tensions.joined() || over_settled_ns < 0) return false;
  // Motion must not start on a zero of slack tendons: the minimum tension does not turn motors to take up
  // what unwound when a drive lost power under tension. Friction alone unwinds less when a robot is
  // released.
  const int slack_tendon = state_.may_be_slack ? SlackTendon(output) : 0;
  if (slack_tendon == 0) return state_.supervisor.Handle(Event::kPretensioned);
  if (over_settled_ns < kTautWithin_ns) return false;
  output.blamed_tendon = slack_tendon;
  return state_.supervisor.Handle(Event::kFault, Status::kTendonSlack);
}

// The first tendon measured slack, from 1; 0: none.
int Modes::SlackTendon(const CycleOutput& output) const noexcept {
  for (int j = 0; j < tendons_; ++j) {
    if (pairs_.Has(j)) continue;  // assembly has pretensioned it
    if (output.tension_measured_N[j] < parameters_.guards.slack_tension_N) return j + 1;
  }
  return 0;
}

bool Modes::EndHoming(const CycleInput& input) noexcept {
  if (!state_.engaged || !take_up_.homed() || !state_.supervisor.Handle(Event::kHomed)) return false;
  BeginAtPretension(input);
  return true;
}

// Motors must not pull on without a current command.
bool Modes::EndCommissioning(const CycleInput& input, CycleOutput& output) noexcept {
  if (!state_.engaged) return false;
  const Target& pull = gate_.target();
  const TimeNs until_ns = pull.kind == CommandKind::kTension ? pull.since_ns + pull.valid_for_ns
                                                             : state_.settled_since_ns + kUnusedFor_ns;
  if (input.time_ns <= until_ns) return false;
  Report(output, Status::kCommissioningEnded);
  return state_.supervisor.Handle(Event::kDisarm);
}

// A moving target whose stream stopped ends in hold, which only a command leaves.
bool Modes::EndSilentStream(const CycleInput& input, CycleOutput& output) noexcept {
  const Target& target = gate_.target();
  const TimeNs silent_ns = input.time_ns - target.since_ns - target.valid_for_ns;
  const auto most_ns = static_cast<TimeNs>(parameters_.guards.max_stream_silence_s * 1e9);
  if (!target.moving() || silent_ns <= most_ns) return false;
  Report(output, Status::kCommandsSilent);
  return state_.supervisor.Handle(Event::kHold);
}

// Runs the bare motors from the time when all drives are enabled until they are off.
Status Modes::TakeTendonsUp(const CycleInput& input, CycleOutput& output) noexcept {
  TendonVector& pulls_N = stages_.tensions.bare_pulls_N();
  Status status = Status::kOk;
  if (state_.mode() == Mode::kHoming) {
    status = take_up_.Home(input, output, pulls_N);
  } else {
    status = take_up_.Watch(input);
  }
  if (state_.mode() == Mode::kCommissioning) {
    const bool asked = gate_.target().kind == CommandKind::kTension;
    const TendonVector none = TendonVector::Zero(tendons_);
    take_up_.Ramp(asked ? gate_.target().tension_N : none, pulls_N);
  }
  if (status != Status::kOk) output.blamed_tendon = take_up_.tendon();
  return status;
}

void Modes::RequestDrives(const CycleInput& input, CycleOutput& output) noexcept {
  output.mode = state_.mode();
  output.drive_request = DriveRequest::kEnable;
  switch (output.mode) {
    case Mode::kArmed:
    case Mode::kPretension:
    case Mode::kRunning:
    case Mode::kHold:
    case Mode::kSafeStop:
    case Mode::kHoming:
    case Mode::kCommissioning:
      break;
    case Mode::kFault:
      // Tensions ramp down on the working drives; then all are disabled until cleared.
      if (stages_.tensions.Released()) stages_.tensions.SetToNone();
      if (stages_.tensions.none()) output.drive_request = DriveRequest::kDisable;
      health_.ReportFault(state_.supervisor.cause(), input, output);
      break;
    case Mode::kDisconnected:
      // In the cycle of a clear the drives have not received it yet.
      if (!output.clear_drive_faults) health_.ReportNotReady(input, output);
      output.drive_request = DriveRequest::kDisable;
      break;
    case Mode::kConfigured:
      output.drive_request = DriveRequest::kDisable;
      break;
  }
}

bool Modes::Powered(const CycleOutput& output) const noexcept {
  return output.drive_request == DriveRequest::kEnable && !state_.enabling();
}

}  // namespace tendril::control
