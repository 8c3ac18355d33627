// Commands on their way to a target or a mode.
#include <algorithm>

#include "../report.h"
#include "modes.h"

namespace tendril::control {

constexpr double kStopRamp_s = 0.9;  // ramp-down time of tensions when the daemon stops

bool Modes::Admit(const CycleInput& input, CycleOutput& output) noexcept {
  bool entered = false;
  const Command& command = input.command;
  if (command.kind != CommandKind::kNone) {
    command_status_ = Judge(input, output);
    ++(command_status_ == Status::kOk ? accepted_ : refused_);
    if (command_status_ != Status::kOk) Report(output, command_status_);
    if (command_status_ == Status::kOk && command.kind == CommandKind::kMode) {
      output.clear_drive_faults = command.mode == ModeRequest::kClear;
      entered = state_.supervisor.Handle(EventOf(command.mode, input.time_ns));
      if (entered) Enter(state_.mode(), input);
    }
  }
  if (gate_.Contended(input.time_ns)) Report(output, Status::kTwoSenders);
  output.commands_accepted = accepted_;
  output.commands_refused = refused_;
  output.command_status = command_status_;
  return entered;
}

// kOk when the command may act.
Status Modes::Judge(const CycleInput& input, CycleOutput& output) noexcept {
  const Command& command = input.command;
  double away_m = 0;
  if (command.kind == CommandKind::kTip && command.tip_W_m.allFinite()) {
    const ReferenceMotion::NearestTip nearest = stages_.reference.NearestTo(command.tip_W_m);
    away_m = nearest.distance_m;
    output.nearest_tip_W_m = nearest.tip_W_m;
  }
  const Status status = gate_.Admit(command, state_.mode(), input.time_ns, away_m);
  const bool clear = command.kind == CommandKind::kMode && command.mode == ModeRequest::kClear;
  if (status == Status::kOk && clear && TensionsRampDown(input)) return Status::kClearTooEarly;
  return status;
}

Event Modes::EventOf(ModeRequest request, TimeNs now_ns) noexcept {
  switch (request) {
    case ModeRequest::kArm:
      return Event::kArm;
    case ModeRequest::kDisarm:
      return Event::kDisarm;
    case ModeRequest::kStop:
      if (state_.stop_by_ns == 0) state_.stop_by_ns = now_ns + static_cast<TimeNs>(kStopRamp_s * kNsPerS);
      return Event::kDisarm;
    case ModeRequest::kHold:
      return Event::kHold;
    case ModeRequest::kClear:
      return Event::kClear;
    case ModeRequest::kHome:
      return Event::kHome;
    case ModeRequest::kCommission:
      return Event::kCommission;
    case ModeRequest::kNotCommissioned:
    case ModeRequest::kNotAlone:
    case ModeRequest::kDriveExchanged:
      break;  // the gate refuses these
  }
  return Event::kHold;
}

// After a fault: tensions are still ramping down.
bool Modes::TensionsRampDown(const CycleInput& input) const noexcept {
  if (state_.mode() != Mode::kFault || stages_.tensions.none()) return false;
  return std::any_of(input.drive.begin(), input.drive.begin() + tendons_,
                     [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
}

}  // namespace tendril::control
