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

std::string_view ModeMeaning(Mode mode) noexcept {
  switch (mode) {
    case Mode::kDisconnected:
      return "Drives are off, started and checked; some are not configured yet.";
    case Mode::kConfigured:
      return "All drives are ready; no torque.";
    case Mode::kArmed:
      return "Drives are being enabled; no torque yet.";
    case Mode::kPretension:
      return "Tensions rise to limits.min_tension_N at controller.pretension_ramp_Nps; then displacement is set to zero.";
    case Mode::kRunning:
      return "The robot follows commands.";
    case Mode::kHold:
      return "The robot stops, keeps its shape and refuses targets.";
    case Mode::kSafeStop:
      return "Tensions ramp down to pretension; then the drives are disabled.";
    case Mode::kFault:
      return "The fault is latched with its cause. Tensions ramp down where they still can; then the drives stay disabled.";
    case Mode::kHoming:
      return "Slack tendons are wound in until each is at pretension; then displacement is set to zero.";
    case Mode::kCommissioning:
      return "Single motors pull as commanded, by controller.take_up.pull_N at most.";
  }
  return "";
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
