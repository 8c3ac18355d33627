// Numbered status codes: what the loop says instead of throwing. The numbers are part of the LCM interface
// and of logs, so a code is never renumbered; new ones are added at the end of their block.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace tendril {

// X(name, number, "text", "remedy"). Blocks of a hundred: see StatusBlocks().
#define TENDRIL_STATUS_LIST(X)                                                                               \
  X(Ok, 0, "ok", "")                                                                                         \
  X(LimitedBendingRate, 101, "bending rate limited by trajectory.max_rate_radps",                            \
    "command a slower motion or raise the limit")                                                            \
  X(LimitedBending, 102, "bending limited by limits.max_bending_rad",                                        \
    "command less bending or raise the limit")                                                               \
  X(LimitedTensionMax, 103, "tension limited by limits.max_tension_base_N, or a pair by its pretension",     \
    "less bending, or raise the one or the other")                                                           \
  X(LimitedTensionMin, 104, "tension raised to limits.min_tension_N",                                        \
    "command at least the minimum tension")                                                                  \
  X(LimitedMotorTension, 105, "motor-side tension limited by limits.max_tension_motor_N",                    \
    "less bending, or raise the limit")                                                                      \
  X(LimitedTorque, 106, "torque limited by the drive's nominal current (actuation.drive.current_limit_A)",   \
    "less bending, or a stronger drive")                                                                     \
  X(TargetUnreachable, 107, "tip target out of reach: going to the nearest reachable point",                 \
    "see target_distance_m")                                                                                 \
  X(LimitedByDrive, 108, "torque limited by the drive itself (internal limit active)",                       \
    "see the drive's torque and current limits (an EPOS4's: object 0x3001) and the motor's temperature")     \
  X(LimitedTipCorrection, 109, "correction by the tracker limited to a fifth of the robot's length",         \
    "check the tracker's frame; else find what differs: tendril gap diagnose")                               \
  X(SlowedByTension, 110,                                                                                    \
    "motion slowed: rotors as fast as that would take more tension than the limits leave",                   \
    "command a slower motion or less bending; with law: paper, try law: equilibrium, which pulls for its "   \
    "rotors")                                                                                                \
  X(LimitedShapeCorrection, 111,                                                                             \
    "correction by the tendons' displacement limited to half of what the robot's stiffness takes",           \
    "look for what holds or loads the robot; else find what differs: tendril gap diagnose")                  \
  X(LimitedDirection, 112,                                                                                   \
    "bend brought to the nearest that the robot's tendons hold: they do not pull every way",                 \
    "ask for a bend in a direction that tendril config check names for this robot")                          \
  X(CommandNotFinite, 201, "command refused: not finite", "send numbers only")                               \
  X(CommandOutOfRange, 202, "command refused: out of range",                                                 \
    "see the robot file's limits; of no robot: more than 1000 rad/s, 100 m or 100 m/s")                      \
  X(CommandStale, 203, "command refused: older than its validity",                                           \
    "send it again, with a longer valid_for_s where it may have to wait; of a stream: see what holds up "    \
    "its sender, the network or the daemon")                                                                 \
  X(CommandWrongMode, 204, "command refused in this mode",                                                   \
    "send what this mode accepts: tendril status says which it is, and why")                                 \
  X(CommandOutOfOrder, 205, "command refused: sequence number not newer than this sender's last",            \
    "count on from the last, or by the clock as Tendril's programs do; two programs need two numbers of "    \
    "their own")                                                                                             \
  X(CommandWrongSize, 206, "command refused: number of values does not fit the robot",                       \
    "one pair per section, one tension per tendon")                                                          \
  X(NotCommissioned, 207, "command refused: this robot was never commissioned as its files are now",         \
    "run tendril commission --config FILE; for a simulation start tendrild with --simulated, or say "        \
    "commissioning: not_required in its file")                                                               \
  X(ClearTooEarly, 208, "clear refused: tensions of the fault are still on their way down",                  \
    "send it again in a moment")                                                                             \
  X(NotAlone, 209,                                                                                           \
    "command refused: another daemon answers on the same LCM channels and would obey it as well",            \
    "stop one of the two, or give each an lcm.channel_prefix (or lcm.url) of its own")                       \
  X(DriveExchanged, 210, "command refused: a drive is another one than at commissioning",                    \
    "run tendril commission --config FILE again, or put the drive back; exchanged_drives: warn lets it arm") \
  X(TargetOutOfReach, 211,                                                                                   \
    "command refused: the tip asked for is farther out of reach than a tenth of the robot's length",         \
    "ask for a point nearer to what the robot reaches")                                                      \
  X(AnotherSender, 212, "command refused: another program is in control of this robot",                      \
    "end one of the two; these count once the other's targets have stopped, or its commissioning has ended") \
  X(CommandExpired, 301, "command stream expired: holding the last target",                                  \
    "keep sending within valid_for_s")                                                                       \
  X(FeedbackMissing, 302, "a drive's TPDO is missing this cycle", "check the bus")                           \
  X(Slack, 303, "a tendon is slack",                                                                         \
    "check pretension and the tendon's path; tendril home takes up what hangs")                              \
  X(CycleLate, 304, "cycle finished late",                                                                   \
    "check the load of this machine and the rights to real-time scheduling")                                 \
  X(SolverFallback, 305, "a bounded solver stopped early: last good solution used", "report with the log")   \
  X(FrameNotSent, 306, "a CAN frame could not be sent: the interface's queue is full",                       \
    "check the bus load and that a node acknowledges")                                                       \
  X(FrameLost, 307, "received CAN frames were lost",                                                         \
    "check the load of this machine and the rights to real-time scheduling")                                 \
  X(DriveWarning, 308, "a drive reports a warning", "see the drive's temperature and load")                  \
  X(CommandsSilent, 310, "the command stream stayed silent for guards.max_stream_silence_s: holding",        \
    "arm to go on; check the sender and LCM")                                                                \
  X(EquilibriumNotFound, 309,                                                                                \
    "controller.law: equilibrium found no stable shape: the paper's tensions are used",                      \
    "less bending, or check stiffness, masses and gravity in the robot file")                                \
  X(TrackerLost, 311, "no usable tracker reading for some time: tip feedback keeps its last correction",     \
    "check the tracker, its clock, frame and units, and its view of the tip")                                \
  X(FrameMalformed, 312, "received CAN frames had a wrong length or unknown contents and were ignored",      \
    "check that every node id is used once and that nothing else sends in the drives' names")                \
  X(ForeignFrame, 313, "another node sends what only the CAN master may send",                               \
    "stop the other master on this bus")                                                                     \
  X(CommissioningEnded, 314, "commissioning: no pull was asked for any more: drives are disabled",           \
    "send commission again")                                                                                 \
  X(CommissioningOff, 315, "commissioning is not required: arms whatever is connected",                      \
    "for simulated robots only; for a real one run tendril commission and say commissioning: required")      \
  X(DriveHasFault, 316, "a drive was found in fault: nothing can be armed",                                  \
    "see its error in the log, mend that, then clear")                                                       \
  X(DriveAbsent, 317, "a drive does not answer or was not started: nothing can be armed",                    \
    "see the log; check power and bus, then clear: it starts all drives again")                              \
  X(Unattended, 318, "what takes commands, writes logs and publishes stood still for a second: disarmed",    \
    "see what blocks the daemon's terminal, pipe or disk, or takes its CPU; then arm")                       \
  X(Degraded, 319, "something beside the control loop is not as it should be; control goes on",              \
    "see the event")                                                                                         \
  X(AnotherDaemon, 320, "another daemon answers on the same LCM channels: disarmed",                         \
    "stop one of the two, or give each an lcm.channel_prefix (or lcm.url) of its own; then arm")             \
  X(MessageIgnored, 321, "a message could not be understood and was ignored",                                \
    "compare the sender's lcm_types with the daemon's")                                                      \
  X(TrackerDisagrees, 322,                                                                                   \
    "tracker and tendons disagree on the tip by more than a tenth of the robot's length",                    \
    "check the tracker's frame and units; else disarm, look whether the robot is straight and no tendon "    \
    "off its pulley, and arm")                                                                               \
  X(TwoSenders, 323, "two programs send targets: one is in control, the other's are refused",                \
    "end one of the two; the log names them")                                                                \
  X(TipErrorLeft, 324,                                                                                       \
    "the tip rests off its goal: tip feedback went twice the error's way without getting it there, and "     \
    "stopped",                                                                                               \
    "look for what holds the robot, and send another target; where it comes again, the robot file has more " \
    "friction than pulleys and gears have, or less play: tendril gap diagnose")                              \
  X(OtherDevice, 325,                                                                                        \
    "a drive is not the device that bus.identity, or its EDS file, names: nothing can be armed",             \
    "see its node and object in the log; correct bus.identity, its EDS file or the node id, or exchange "    \
    "the drive; then clear")                                                                                 \
  X(DriveMisconfigured, 326,                                                                                 \
    "a drive refused or did not keep its configuration, or its motor data differ from the robot file: "      \
    "nothing can be armed",                                                                                  \
    "see its node, step and object in the log; correct the robot or daemon file, or restore the drive's "    \
    "defaults (0x1011); then clear")                                                                         \
  X(NodeIdTwice, 327, "two drives answer with one node id: nothing can be armed",                            \
    "disconnect one of the two and give it a node id of its own; then clear")                                \
  X(CyclesMissed, 328,                                                                                       \
    "the daemon misses more of its own cycles than guards.max_late_cycles, and drives seem not to answer",   \
    "first take load off this machine and set up real time: tendril rt-check; then clear")                   \
  X(DriveLost, 401, "fault: a drive stopped answering", "check power and bus, then clear")                   \
  X(DriveFault, 402, "fault: a drive reports an error", "see the drive's error code, then clear")            \
  X(BusOff, 403, "fault: the CAN interface went bus-off", "check wiring and termination, then clear")        \
  X(TensionOverLimit, 404,                                                                                   \
    "fault: measured tension over limits.max_tension_motor_N or, at the base, limits.max_tension_base_N",    \
    "find what blocks the tendon, then clear")                                                               \
  X(InternalNotFinite, 405, "fault: a computed value is not finite", "report with the log")                  \
  X(FeedbackStale, 406, "fault: feedback missing for longer than guards.max_missing_cycles",                 \
    "check the bus, then clear")                                                                             \
  X(BootFailed, 407, "fault: a drive could not be configured", "see the event for node, step and object")    \
  X(ConfigurationMismatch, 408, "fault: a drive does not match the configuration",                           \
    "see the event for node and object")                                                                     \
  X(TendonSlack, 409,                                                                                        \
    "fault: a tendon was slack for longer than guards.max_slack_s, or when pretension should have ended",    \
    "look at the tendon's path, then clear; what hangs, as after power was lost under tension, is taken up " \
    "by tendril home")                                                                                       \
  X(SensorDisconnected, 410, "fault: a load cell shows what no tendon can pull",                             \
    "check its cable and supply, then clear")                                                                \
  X(SensorStuck, 411,                                                                                        \
    "fault: a load cell keeps one value while the torque changes by guards.stuck_torque_change_N",           \
    "check its cable and amplifier, then clear")                                                             \
  X(SensorDisagrees, 412,                                                                                    \
    "fault: load cell and motor torque disagree by more than guards.tension_disagreement_N",                 \
    "check gain and offset of the cell, then what blocks the tendon; then clear")                            \
  X(DisplacementJump, 413, "fault: a tendon moved by more than guards.max_displacement_jump_m in one cycle", \
    "check the encoder and its cable, then clear")                                                           \
  X(DisplacementRate, 414, "fault: a spool turned faster than guards.max_displacement_rate_mps",             \
    "check the tendon (has it torn?), then clear")                                                           \
  X(FollowingError, 415, "fault: a tendon is off its reference by more than guards.max_following_error_m",   \
    "find what holds the robot, then clear; where tendons hang, tendril home")                               \
  X(BendingOverLimit, 416,                                                                                   \
    "fault: the robot is bent beyond limits.max_bending_rad by more than guards.max_bending_excess_rad",     \
    "find what bends it, then clear")                                                                        \
  X(EstimatorDiverged, 417,                                                                                  \
    "fault: no shape explains the tendons' displacements within guards.max_estimator_residual_m",            \
    "check the encoders and the tendons' paths, then clear and pretension anew")                             \
  X(CyclesLate, 418, "fault: more cycles than guards.max_late_cycles were skipped",                          \
    "check the load of this machine with tendril rt-check, then clear")                                      \
  X(TimeStepped, 419, "fault: the controller's time did not go on by whole cycles", "report with the log")   \
  X(DriveFrozen, 420, "fault: a drive's torque does not follow its target within guards.max_torque_error_N", \
    "switch the drive off and on, then clear; the event tells the node")                                     \
  X(TravelOverLimit, 421, "fault: a tendon travelled farther than controller.take_up.max_travel_m",          \
    "look whether it hangs loose or runs off its spool, then clear")                                         \
  X(TendonBroken, 422,                                                                                       \
    "fault: homing wound in controller.take_up.max_travel_m of a tendon and no tension came",                \
    "hook it in again, or raise the limit if it is that slack; then clear")                                  \
  X(TendonJammed, 423, "fault: homing: a motor does not turn and its tendon has no tension",                 \
    "find what holds gear or spool, check the encoder, or raise controller.take_up.pull_N; then clear")      \
  X(CellDead, 424, "fault: homing: a motor winds in until it stands, and its load cell does not answer",     \
    "check its cable and amplifier, commission again; then clear")                                           \
  X(HomingTimedOut, 425, "fault: homing took longer than controller.take_up.timeout_s",                      \
    "raise the limit, or find what keeps the tendons from becoming taut; then clear")                        \
  X(InterfaceDown, 426, "fault: the CAN interface is down or gone",                                          \
    "plug its adapter in, bring it up (ip link set IFACE up), then clear")                                   \
  X(EnableTimedOut, 427,                                                                                     \
    "fault: a drive was commanded to switch on, and is not on with its feedback within 3 s",                 \
    "see its state, error and age of feedback (tendril status --watch), then clear")                         \
  X(NodeIdShared, 428, "fault: two drives answer with one node id",                                          \
    "disconnect one of the two and give it a node id of its own; then clear")

enum class Status : std::uint16_t {
#define TENDRIL_STATUS_ENUM(name, number, text, remedy) k##name = number,
  TENDRIL_STATUS_LIST(TENDRIL_STATUS_ENUM)
#undef TENDRIL_STATUS_ENUM
};

/// One line for people: what happened, and which configuration key acts where one does.
std::string_view StatusText(Status status) noexcept;
/// What to do about it; empty where nothing is needed.
std::string_view StatusRemedy(Status status) noexcept;

struct StatusEntry {
  Status status{};
  std::string_view name;  // "LimitedBending"
};
/// Every status, as the list above has them.
std::span<const StatusEntry> Statuses() noexcept;

/// Hundred numbers of one severity.
struct StatusBlock {
  int first = 0;
  std::string_view title, meaning;
};
/// By rising number, which is rising severity.
std::span<const StatusBlock> StatusBlocks() noexcept;

/// Whether it explains a mode that no command caused: faults, and what prevents arming or ended a motion.
bool ExplainsMode(Status status) noexcept;

inline bool IsFault(Status status) noexcept { return static_cast<std::uint16_t>(status) >= 400; }

}  // namespace tendril
