#include "modes.h"

#include "tendril/control/state_archive.h"

namespace tendril::control {

Modes::Modes(const RobotParameters& robot, const ControllerParameters& parameters,
             const LimitParameters& limits, TimeNs period_ns, const Stages& stages)
    : parameters_(parameters),
      limits_(limits),
      sections_(static_cast<int>(robot.body.sections.size())),
      tendons_(robot.body.tendons()),
      pairs_(robot),
      stages_(stages),
      gate_(robot, parameters.trajectory.default_speed_radps, parameters.take_up.pull_N),
      take_up_(robot, parameters.take_up, parameters.pretension_ramp_Nps, parameters.pretension_settle_s,
               period_ns),
      health_(robot, parameters.guards, stages.guards) {}

void Modes::Archive(StateArchive& a) noexcept {
  gate_.Archive(a);
  take_up_.Archive(a);
  health_.Archive(a);
  state_.Archive(a);
  a.Value(accepted_);
  a.Value(refused_);
  a.Choice(command_status_, static_cast<Status>(999));
}

void ModeState::Archive(StateArchive& a) noexcept {
  supervisor.Archive(a);
  a.Value(engaged);
  a.Value(bare);
  a.Value(zeroed);
  a.Value(zero_known);
  a.Value(may_be_slack);
  a.Value(stop_by_ns);
  a.Value(settled_since_ns);
  for (bool& off : was_off) a.Value(off);
}

}  // namespace tendril::control
