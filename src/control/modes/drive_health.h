// Health of bus and drives: what is missing or failed, and whether that is a fault in the present mode.
// Decides on no mode.
#pragma once

#include <cstdint>

#include "mode_state.h"
#include "tendril/control/guards.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::control {

class StateArchive;

class DriveHealth {
 public:
  /// The guards outlive this object.
  DriveHealth(const RobotParameters& robot, const GuardParameters& parameters, Guards& guards);

  struct Commanded {
    bool tension = false;  // some tension is commanded
    bool shape = false;    // a shape is commanded, not tensions
  };
  /// The first fault of this cycle, with its tendon in `output`; kOk when there is none. Notes in `state`
  /// which zero and which tendon a failed drive leaves uncertain.
  Status Check(const CycleInput& input, const Commanded& commanded, ModeState& state,
               CycleOutput& output) noexcept;

  /// Why a disconnected robot is not ready, unless its drives are still starting. A control loop that misses
  /// cycles makes drives appear absent, so both are reported.
  void ReportNotReady(const CycleInput& input, CycleOutput& output) const noexcept;
  /// The latched cause of a fault, and what may explain a lost drive.
  void ReportFault(Status cause, const CycleInput& input, CycleOutput& output) const noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  Status CheckDrive(const DriveFeedback& drive, int tendon, bool overdue, bool powered, ModeState& state,
                    CycleOutput& output) noexcept;
  Status NotReady(const CycleInput& input) const noexcept;

  int tendons_;
  model::TendonPairs pairs_;
  int max_missing_cycles_;
  double slack_tension_N_;
  Guards& guards_;
  std::uint32_t missing_ = 0;  // feedback, since start
};

}  // namespace tendril::control
