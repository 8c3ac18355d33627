#include "tendril/core/cycle.h"

namespace tendril {

std::string_view ModeText(Mode mode) noexcept {
  switch (mode) {
    case Mode::kDisconnected: return "disconnected";
    case Mode::kConfigured: return "configured";
    case Mode::kArmed: return "armed";
    case Mode::kPretension: return "pretension";
    case Mode::kRunning: return "running";
    case Mode::kHold: return "hold";
    case Mode::kSafeStop: return "safe stop";
    case Mode::kFault: return "fault";
    case Mode::kHoming: return "homing";
    case Mode::kCommissioning: return "commissioning";
  }
  return "unknown";
}

Status WhyNotReady(DriveState state) noexcept {
  switch (state) {
    case DriveState::kOffline:
    case DriveState::kUnreachable:
      return Status::kDriveAbsent;
    case DriveState::kFault:
      return Status::kDriveHasFault;
    case DriveState::kOtherDevice:
      return Status::kOtherDevice;
    case DriveState::kMisconfigured:
      return Status::kDriveMisconfigured;
    case DriveState::kIdTwice:
      return Status::kNodeIdTwice;
    case DriveState::kBooting:
    case DriveState::kReady:
    case DriveState::kEnabled:
    case DriveState::kQuickStop:
      break;
  }
  return Status::kOk;
}

}  // namespace tendril
