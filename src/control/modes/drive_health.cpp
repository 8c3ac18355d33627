#include "drive_health.h"

#include <algorithm>

#include "../report.h"
#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// Drives need some hundredths of a second to switch on. The master gives up after 2 s with a more specific
// status.
constexpr TimeNs kEnableWithin_ns = 3 * kNsPerS;

bool Mismatched(DriveState state) noexcept {
  return state == DriveState::kOtherDevice || state == DriveState::kMisconfigured;
}

bool Answers(DriveState state) noexcept {
  return state != DriveState::kOffline && state != DriveState::kBooting &&
         state != DriveState::kUnreachable && state != DriveState::kIdTwice && !Mismatched(state);
}

Status FirstOf(Status first, Status then) noexcept { return first != Status::kOk ? first : then; }

}  // namespace

DriveHealth::DriveHealth(const RobotParameters& robot, const GuardParameters& parameters, Guards& guards)
    : tendons_(robot.body.tendons()),
      pairs_(robot),
      max_missing_cycles_(parameters.max_missing_cycles),
      slack_tension_N_(parameters.slack_tension_N),
      guards_(guards) {}

Status DriveHealth::Check(const CycleInput& input, const Commanded& commanded, ModeState& state,
                          CycleOutput& output) noexcept {
  Status worst = Status::kOk;
  const auto fault = [&](Status s, int tendon) {
    if (worst == Status::kOk && s != Status::kOk) output.blamed_tendon = tendon;
    worst = FirstOf(worst, s);
  };
  const Mode mode = state.mode();
  const bool enabling = state.enabling();
  const bool overdue = enabling && input.time_ns - state.settled_since_ns > kEnableWithin_ns;
  // A safe stop entered before the drives were on has nothing to guard.
  const bool nothing = mode == Mode::kSafeStop && !commanded.tension;
  const bool powered = mode != Mode::kDisconnected && mode != Mode::kConfigured && mode != Mode::kFault &&
                       !enabling && !nothing;
  // All drives drop out when the interface does, so the interface is reported.
  const bool down = input.drive[0].state == DriveState::kUnreachable;
  if (!input.bus_ok) fault(down ? Status::kInterfaceDown : Status::kBusOff, 0);
  for (int j = 0; j < tendons_; ++j)
    fault(CheckDrive(input.drive[j], j, overdue, powered, state, output), j + 1);
  output.feedback_missing = missing_;
  const bool stops_shape = mode == Mode::kSafeStop && state.zeroed;
  const Status broken = guards_.Check(input, output,
                                      {.powered = powered,
                                       .trusted = !state.bare,
                                       .tensioned = state.controls_shape() || (powered && stops_shape),
                                       .follows = state.controls_shape() && commanded.shape});
  fault(broken, guards_.tendon());
  return worst;
}

Status DriveHealth::CheckDrive(const DriveFeedback& d, int j, bool overdue, bool powered, ModeState& state,
                               CycleOutput& output) noexcept {
  Status worst = Status::kOk;
  const auto fault = [&worst](Status s) { worst = FirstOf(worst, s); };
  const bool answers = Answers(d.state);
  if (d.state == DriveState::kIdTwice) fault(Status::kNodeIdShared);
  if (Mismatched(d.state)) fault(Status::kConfigurationMismatch);
  if (!answers) {
    fault(Status::kDriveLost);
    state.may_be_slack = state.may_be_slack || state.zero_known;
    state.zero_known = false;
  }
  if (d.state == DriveState::kFault) {
    fault(Status::kDriveFault);
    state.may_be_slack = true;
  }
  const bool on = state.was_off[j] && d.state == DriveState::kEnabled && d.age_cycles == 0;
  if (overdue && !on) fault(Status::kEnableTimedOut);
  // A drive that left operation enabled unrequested while holding a tendon is a fault as well.
  if (powered && d.state != DriveState::kEnabled) fault(Status::kDriveFault);
  if (answers && d.age_cycles > 0) {
    ++missing_;
    Report(output, Status::kFeedbackMissing);
    // Without torque on the tendons a stale value is harmless; arming waits for a fresh one.
    if (powered && d.age_cycles > max_missing_cycles_) fault(Status::kFeedbackStale);
  }
  // The tension of a pair's tendon is inferred from the motor's, without a sensor to see it slack.
  if (state.controls_shape() && output.tension_measured_N[j] < slack_tension_N_ && !pairs_.Has(j))
    Report(output, Status::kSlack);
  return worst;
}

// Errors of a drive that answers take precedence over missing drives.
Status DriveHealth::NotReady(const CycleInput& input) const noexcept {
  const auto end = input.drive.begin() + tendons_;
  for (const DriveState state : {DriveState::kUnreachable, DriveState::kIdTwice, DriveState::kOtherDevice,
                                 DriveState::kMisconfigured, DriveState::kFault, DriveState::kOffline}) {
    const auto is = [state](const DriveFeedback& d) { return d.state == state; };
    if (std::any_of(input.drive.begin(), end, is)) return WhyNotReady(state);
  }
  return Status::kOk;
}

void DriveHealth::ReportNotReady(const CycleInput& input, CycleOutput& output) const noexcept {
  const Status why = NotReady(input);
  if (why == Status::kDriveAbsent && guards_.behind()) Report(output, Status::kCyclesMissed);
  Report(output, why);
}

void DriveHealth::ReportFault(Status cause, const CycleInput& input, CycleOutput& output) const noexcept {
  Report(output, cause);
  // A duplicate node id is detected shortly after it made the first drive seem to restart.
  if (cause == Status::kDriveLost && NotReady(input) == Status::kNodeIdTwice)
    Report(output, Status::kNodeIdTwice);
  const bool of_drives =
      cause == Status::kDriveLost || cause == Status::kDriveFault || cause == Status::kFeedbackStale;
  if (of_drives && guards_.behind()) Report(output, Status::kCyclesMissed);
}

void DriveHealth::Archive(StateArchive& a) noexcept { a.Value(missing_); }

}  // namespace tendril::control
