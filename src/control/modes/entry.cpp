// What each mode does when it is entered.
#include "../report.h"
#include "modes.h"

namespace tendril::control {

void Modes::Enter(Mode mode, const CycleInput& input) noexcept {
  switch (mode) {
    case Mode::kDisconnected:
    case Mode::kConfigured:
    case Mode::kArmed:
    case Mode::kHoming:
    case Mode::kCommissioning:
      EnterAtRest(mode, input);
      break;
    case Mode::kPretension:
      stages_.guards.Restart();
      stages_.tensions.Leave();
      state_.settled_since_ns = input.time_ns;
      break;
    case Mode::kRunning:
      if (!state_.zeroed) BeginAtPretension(input);  // else resumed from hold
      break;
    case Mode::kHold:
      gate_.Drop();
      break;
    case Mode::kSafeStop:
    case Mode::kFault:
      gate_.Drop();
      stages_.reference.Restart();
      stages_.tensions.Leave();
      break;
  }
}

void Modes::EnterAtRest(Mode mode, const CycleInput& input) noexcept {
  gate_.Drop();
  stages_.tensions.Reset();
  // Friction settles on the straight robot while tensions rise; a path left from an earlier motion would
  // cause a jump when the robot runs.
  stages_.reference.Reset(stages_.estimator.pretension_rad());
  // Pretension alone winds in tendon where it bends the robot.
  stages_.torques.Reset(stages_.estimator.pretension_m());
  stages_.law.Reset();
  if (mode == Mode::kHoming || mode == Mode::kCommissioning) state_.zero_known = false;
  state_.engaged = state_.bare = state_.zeroed = false;
  state_.stop_by_ns = 0;
  state_.settled_since_ns = input.time_ns;
  for (int j = 0; j < tendons_; ++j) state_.was_off[j] = input.drive[j].state != DriveState::kEnabled;
}

// Displacement counts from the robot at pretension. When armed again the robot may be bent by friction, so a
// zero that the encoders still hold is preferred.
void Modes::BeginAtPretension(const CycleInput& input) noexcept {
  if (!state_.zero_known) stages_.estimator.ZeroDisplacement(input);
  state_.zero_known = true;
  state_.may_be_slack = false;
  stages_.reference.Reset(stages_.estimator.pretension_rad());
  if (state_.bare) {
    stages_.guards.Restart();
    stages_.tensions.SetToRest();
  }
  stages_.tensions.Leave();
  state_.bare = false;
  state_.zeroed = true;
}

void Modes::ReleaseAll(CycleOutput& output) noexcept {
  output.torque_desired_Nm.setZero();
  stages_.tensions.SetToNone();
  stages_.reference.Reset(BendingVector::Zero(2 * sections_));
  state_.supervisor.Handle(Event::kFault, Status::kInternalNotFinite);
  output.mode = state_.mode();
  output.drive_request = DriveRequest::kDisable;
  Report(output, Status::kInternalNotFinite);
}

}  // namespace tendril::control
