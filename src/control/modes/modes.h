// The robot's modes: what a command, the drives' health and the stages' progress change, what each mode does
// on entry and in each cycle, and which tensions it commands. Knows nothing of the law.
#pragma once

#include "../stages/commanded_tensions.h"
#include "../stages/drive_torques.h"
#include "../stages/reference_motion.h"
#include "drive_health.h"
#include "mode_state.h"
#include "tendril/control/estimator.h"
#include "tendril/control/gate.h"
#include "tendril/control/guards.h"
#include "tendril/control/law.h"
#include "tendril/control/take_up.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

class Modes {
 public:
  /// What modes start, hold and reset.
  struct Stages {
    Estimator& estimator;
    Guards& guards;
    ReferenceMotion& reference;
    CommandedTensions& tensions;
    DriveTorques& torques;
    Law& law;
  };

  /// Parameters and stages outlive this object; commanded tensions are those of `limits`.
  Modes(const RobotParameters& robot, const ControllerParameters& parameters, const LimitParameters& limits,
        TimeNs period_ns, const Stages& stages);

  // In flow order of a cycle.

  /// The cycle's command through the gate. True when it changed the mode.
  bool Admit(const CycleInput& input, CycleOutput& output) noexcept;
  /// Health, then what the mode does by itself; `entered`: by a command of this cycle. Sets mode and
  /// drive_request of `output`.
  void Supervise(const CycleInput& input, CycleOutput& output, bool entered) noexcept;
  /// The mode's tensions at the base, from the law's in `output`. `switched`: they have another source than
  /// in the last cycle.
  void CommandTensions(bool switched, CycleOutput& output) noexcept;
  /// A torque is not a number: releases everything at once.
  void ReleaseAll(CycleOutput& output) noexcept;
  /// Torques may be sent.
  bool Powered(const CycleOutput& output) const noexcept;

  const ModeState& state() const noexcept { return state_; }
  const Target& target() const noexcept { return gate_.target(); }
  /// Of motors whose tendons' state is unknown; else null.
  const TakeUp* bare() const noexcept { return state_.bare ? &take_up_ : nullptr; }

  void Archive(StateArchive& archive) noexcept;

 private:
  // commands.cpp
  Status Judge(const CycleInput& input, CycleOutput& output) noexcept;
  Event EventOf(ModeRequest request, TimeNs now_ns) noexcept;
  bool TensionsRampDown(const CycleInput& input) const noexcept;
  // cycle.cpp
  bool Advance(const CycleInput& input, CycleOutput& output, bool ready, bool enabled) noexcept;
  bool EndPretension(const CycleInput& input, CycleOutput& output) noexcept;
  bool EndHoming(const CycleInput& input) noexcept;
  bool EndCommissioning(const CycleInput& input, CycleOutput& output) noexcept;
  bool EndSilentStream(const CycleInput& input, CycleOutput& output) noexcept;
  Status TakeTendonsUp(const CycleInput& input, CycleOutput& output) noexcept;
  void RequestDrives(const CycleInput& input, CycleOutput& output) noexcept;
  int SlackTendon(const CycleOutput& output) const noexcept;
  // entry.cpp
  void Enter(Mode mode, const CycleInput& input) noexcept;
  void EnterAtRest(Mode mode, const CycleInput& input) noexcept;
  void BeginAtPretension(const CycleInput& input) noexcept;
  // tensions.cpp
  void CommandShape(bool switched, CycleOutput& output) noexcept;

  const ControllerParameters& parameters_;
  LimitParameters limits_;
  int sections_, tendons_;
  model::TendonPairs pairs_;
  Stages stages_;
  CommandGate gate_;
  TakeUp take_up_;
  DriveHealth health_;
  ModeState state_;
  std::uint32_t accepted_ = 0, refused_ = 0;  // commands
  Status command_status_ = Status::kOk;       // of the last command
};

}  // namespace tendril::control
