#include "tendril/control/guard_table.h"

namespace tendril::control {
namespace {

constexpr std::string_view kAtOnce = "1 cycle", kConfirmed = "confirm_cycles";

constexpr GuardEntry kGuards[] = {
    {"a measured tension is over the limit at the motor, or surely over that at the base",
     "controller.guards.tension_margin limits.max_tension_motor_N limits.max_tension_base_N",
     Status::kTensionOverLimit, Watch::kPowered, "1 cycle; confirm_cycles without a load cell"},
    {"a tendon is slack", "controller.guards.slack_tension_N controller.guards.max_slack_s",
     Status::kTendonSlack, Watch::kTensioned, "max_slack_s"},
    {"a load cell is at the end of its range, negative, or shows nothing under torque",
     "controller.guards.tension_disagreement_N controller.guards.confirm_cycles", Status::kSensorDisconnected,
     Watch::kTrusted, kConfirmed},
    {"a load cell keeps one value while the torque changes", "controller.guards.stuck_torque_change_N",
     Status::kSensorStuck, Watch::kTrusted, "200 cycles and the change"},
    {"load cell and motor torque disagree",
     "controller.guards.tension_disagreement_N controller.guards.confirm_cycles", Status::kSensorDisagrees,
     Watch::kTrusted, kConfirmed},
    {"a tendon jumps", "controller.guards.max_displacement_jump_m", Status::kDisplacementJump,
     Watch::kPowered, kAtOnce},
    {"a spool is too fast", "controller.guards.max_displacement_rate_mps controller.guards.confirm_cycles",
     Status::kDisplacementRate, Watch::kPowered, "confirm_cycles after the low-pass of the speed"},
    {"a tendon is off its reference",
     "controller.guards.max_following_error_m controller.guards.confirm_cycles", Status::kFollowingError,
     Watch::kFollowing, kConfirmed},
    {"the robot is bent too far",
     "controller.guards.max_bending_excess_rad limits.max_bending_rad controller.guards.confirm_cycles",
     Status::kBendingOverLimit, Watch::kTensioned, kConfirmed},
    {"no shape explains the displacements",
     "controller.guards.max_estimator_residual_m controller.guards.confirm_cycles",
     Status::kEstimatorDiverged, Watch::kTensioned, kConfirmed},
    {"a drive's torque does not follow, or not a digit of its feedback changes while torque is commanded",
     "controller.guards.max_torque_error_N controller.guards.confirm_cycles", Status::kDriveFrozen,
     Watch::kPowered, "confirm_cycles; 200 cycles"},
    {"cycles are skipped", "controller.guards.max_late_cycles", Status::kCyclesLate, Watch::kPowered,
     kAtOnce},
    {"the controller's time leaves the grid", "", Status::kTimeStepped, Watch::kPowered, kAtOnce},
    {"a computed value is not finite", "", Status::kInternalNotFinite, Watch::kAlways, kAtOnce},
    {"a drive's feedback is missing", "controller.guards.max_missing_cycles", Status::kFeedbackStale,
     Watch::kPowered, "max_missing_cycles and 2 cycles"},
    {"a drive stops answering", "bus.heartbeat_timeout_ms", Status::kDriveLost, Watch::kAlways,
     "heartbeat_timeout_ms"},
    {"a drive reports an error, or disables itself", "", Status::kDriveFault, Watch::kAlways,
     "up to 3 cycles"},
    {"a drive does not switch on when it should", "", Status::kEnableTimedOut, Watch::kPowered, "3 s"},
    {"a drive cannot be configured", "bus.sdo_timeout_ms bus.boot_timeout_ms", Status::kBootFailed,
     Watch::kAlways, "boot_timeout_ms"},
    {"a drive does not match the configuration", "bus.identity", Status::kConfigurationMismatch,
     Watch::kAlways, kAtOnce},
    {"two drives answer with one node id", "", Status::kNodeIdShared, Watch::kAlways, "up to 16 cycles"},
    {"the CAN interface is bus-off", "", Status::kBusOff, Watch::kAlways, "up to 3 cycles"},
    {"the CAN interface is down or gone", "", Status::kInterfaceDown, Watch::kAlways, "up to 3 cycles"},
    {"a tendon travels too far", "controller.take_up.max_travel_m", Status::kTravelOverLimit, Watch::kTakeUp,
     kAtOnce},
    {"no tension comes while a tendon is wound in", "controller.take_up.max_travel_m", Status::kTendonBroken,
     Watch::kTakeUp, kAtOnce},
    {"a motor does not turn and its tendon has no tension", "controller.take_up.pull_N",
     Status::kTendonJammed, Watch::kTakeUp, "while it stands"},
    {"a motor winds in until it stands and its load cell does not answer", "", Status::kCellDead,
     Watch::kTakeUp, "while it stands"},
    {"homing takes too long", "controller.take_up.timeout_s", Status::kHomingTimedOut, Watch::kTakeUp,
     "timeout_s"},
    {"a stream of moving targets is silent", "controller.guards.max_stream_silence_s",
     Status::kCommandsSilent, Watch::kFollowing, "max_stream_silence_s after the last target expired"},
};

}  // namespace

std::string_view WatchText(Watch watch) noexcept {
  switch (watch) {
    case Watch::kAlways:
      return "always";
    case Watch::kPowered:
      return "while motors pull";
    case Watch::kTrusted:
      return "while motors pull, load cells known to work";
    case Watch::kTensioned:
      return "once displacement is zeroed";
    case Watch::kFollowing:
      return "while commands are followed";
    case Watch::kTakeUp:
      return "while commissioning or homing";
  }
  return "";
}

std::span<const GuardEntry> GuardTable() noexcept { return kGuards; }

}  // namespace tendril::control
