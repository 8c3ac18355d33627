// The tensions that each mode commands.
#include "../report.h"
#include "modes.h"

namespace tendril::control {

void Modes::CommandTensions(bool switched, CycleOutput& output) noexcept {
  CommandedTensions& tensions = stages_.tensions;
  switch (state_.mode()) {
    case Mode::kDisconnected:
    case Mode::kConfigured:
    case Mode::kArmed:
      tensions.SetToNone();
      break;
    case Mode::kPretension:
      if (!tensions.joined()) state_.settled_since_ns = output.time_ns;
      tensions.Follow(tensions.rest_N());
      break;
    case Mode::kRunning:
    case Mode::kHold:
      CommandShape(switched, output);
      break;
    case Mode::kHoming:
    case Mode::kCommissioning:
      break;  // pulled by TakeTendonsUp
    case Mode::kSafeStop:
    case Mode::kFault:
      if (state_.stop_by_ns > 0) {
        // By the clock, so that skipped cycles do not delay the stop.
        tensions.RampDown(ToSeconds(state_.stop_by_ns - output.time_ns));
      } else {
        tensions.RampDown({});
      }
      break;
  }
  output.tension_desired_base_N = tensions.tension_N();
}

// The law's tensions, or those of a command within the limits.
void Modes::CommandShape(bool switched, CycleOutput& output) noexcept {
  CommandedTensions& tensions = stages_.tensions;
  if (!stages_.reference.tension_commanded()) {
    tensions.Follow(output.tension_desired_base_N);
    return;
  }
  const bool asked = gate_.target().kind == CommandKind::kTension;
  const TendonVector commanded_N = asked ? gate_.target().tension_N : tensions.tension_N();
  const double least_N = limits_.min_tension_N, most_N = limits_.max_tension_base_N;
  TendonVector goal_N = commanded_N.cwiseMax(least_N).cwiseMin(most_N);
  const bool pair_limited = pairs_.Share(stages_.estimator.shortening_m(), most_N, goal_N);
  tensions.FollowCommand(goal_N, switched);
  if (commanded_N.minCoeff() < least_N) Report(output, Status::kLimitedTensionMin);
  if (commanded_N.maxCoeff() > most_N || pair_limited) Report(output, Status::kLimitedTensionMax);
}

}  // namespace tendril::control
