// Parameters of controller, bus and daemon from their configuration file: plain numbers with units.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tendril/core/clock.h"

namespace tendril {

/// Limits of the desired motion, per section, on the vector (us, vs).
struct TrajectoryParameters {
  double default_speed_radps = 0;       // of point-to-point moves that name no speed
  double max_rate_radps = 0;
  double max_acceleration_radps2 = 0;
  double max_jerk_radps3 = 0;
  /// A moving target is extrapolated as far ahead as smoothing and drives delay; false: the sender sends ahead.
  bool look_ahead = true;
};

struct GuardParameters {
  int max_missing_cycles = 0;           // feedback older than this is a fault
  double slack_tension_N = 0;           // measured tension below this reports slack
  double max_slack_s = 30;              // slack for longer is a fault
  double tension_margin = 0.1;          // measured above limits.max_tension_motor_N by more than this share: a fault
  int confirm_cycles = 20;              // so long in a row each of the rules below must be broken
  double tension_disagreement_N = 2;  // between load cell and what the motor's torque allows
  double stuck_torque_change_N = 2;     // of tension by torque, while the load cell shows one value
  double max_displacement_jump_m = 5e-4;     // in one cycle; needs no confirmation
  double max_displacement_rate_mps = 0.2;    // of the spool
  double max_following_error_m = 4e-3;       // of a tendon's displacement
  double max_bending_excess_rad = 0.3;       // of the estimate beyond limits.max_bending_rad
  double max_estimator_residual_m = 2e-3;    // of a tendon's displacement that no shape explains
  double max_torque_error_N = 1;        // of tension by torque, between target and what the drive reports
  int max_late_cycles = 100;            // skipped at once, or within about a second
  double max_stream_silence_s = 1;      // after a moving target expired; then hold
};

/// How tendons are handled before anything is known of them: commissioning and homing.
struct TakeUpParameters {
  double pull_N = 2;                    // of a motor's torque, losses left aside; what commissioning may ask for
  double max_speed_mps = 0.005;         // of a tendon; the torque fades as it is approached
  double max_travel_m = 0.03;           // of a tendon, either way
  double timeout_s = 30;                // of homing as a whole
};

enum class ControlLaw {
  kPaper,        // arcs of constant curvature, Kane's equations projected on them
  kEquilibrium,  // every unit's own balance, with the section ends where the arcs have them
};

struct ControllerParameters {
  ControlLaw law = ControlLaw::kPaper;
  bool tension_feedback = false;        // of the load cells; with the equilibrium law only
  bool shape_feedback = false;          // of the tendons' displacement; with tension feedback only
  bool tip_feedback = false;            // of the tracker; with tension feedback only
  bool capstan_compensation = true;     // false replaces the Capstan map and its inverse by the identity, nothing else
  double pretension_ramp_Nps = 0;       // rate at which tensions rise to and fall from their targets on arm / disarm
  double pretension_settle_s = 0;       // stillness before tendon displacement is zeroed
  TrajectoryParameters trajectory;
  GuardParameters guards;
  TakeUpParameters take_up;
};

/// The kinds of drive that the CANopen room has a profile of, and their words in the daemon file.
enum class DriveKind : std::uint8_t { kEpos4, kCia402 };
inline const std::initializer_list<std::pair<std::string_view, DriveKind>> kDriveKinds = {
    {"epos4", DriveKind::kEpos4},   // maxon EPOS4
    {"cia402", DriveKind::kCia402}  // any CiA 402 drive with cyclic synchronous torque, by its maker's EDS file
};

struct IdentityParameters {             // what object 0x1018 must report
  std::uint32_t vendor_id = 0;
  std::vector<std::uint32_t> product_codes;  // any of these
  std::uint32_t min_revision = 0, max_revision = 0;
};

struct NodeParameters {
  int node_id = 0;                      // 1..127
  int tendon = 0;                       // 1..M
  bool motor_reversed = false;          // negative torque pulls
  bool encoder_reversed = false;        // counts fall when the motor pulls
  DriveKind profile = DriveKind::kEpos4;
  std::string eds_file{};               // of a generic drive; absolute, or relative to the daemon's file
  std::string analog_input{};           // of a generic drive: its load cell's object, "0x6401:01"; empty: none
  double analog_mV_per_count = 1;       // of that object
};

struct BusParameters {
  std::string interface;                // for example can0
  int bitrate_bps = 0;
  TimeNs cycle_ns = 0;
  TimeNs feedback_deadline_ns = 0;      // after SYNC; TPDOs that come later count as missing
  int heartbeat_ms = 0;                 // produced by master and drives
  int heartbeat_timeout_ms = 0;         // consumed by both
  int sdo_timeout_ms = 0;
  int boot_timeout_ms = 0;              // per node, NMT to configured
  int abort_connection_option = 0;      // 0x6007: 2 disable voltage, 3 quick stop
  double max_load = 0.8;                // refuse to start above this share of the bit rate
  IdentityParameters identity;          // of the EPOS4 drives; no product codes: there are none of them
  std::vector<NodeParameters> nodes;    // in tendon order once loaded
};

struct RealtimeParameters {
  int priority = 0;                     // SCHED_FIFO; 0: ordinary scheduling
  int cpu = -1;                         // -1: any
  bool lock_memory = true;
  bool required = false;                // true: refuse to start without the rights; false: warn
};

/// LCM takes the names of subscriptions for patterns, so one rule holds wherever a prefix is given.
bool IsChannelPrefix(std::string_view prefix) noexcept;
inline constexpr std::string_view kChannelPrefixRule = "1 to 40 letters, digits and '_'";

/// udpm://ADDRESS:PORT with a multicast address, as LCM understands it; or one of its other kinds, unchecked.
bool IsLcmUrl(std::string_view url) noexcept;
inline constexpr std::string_view kLcmUrlRule =
    "udpm://ADDRESS:PORT?ttl=N with a multicast address (224.0.0.0 to 239.255.255.255), a port from 1 to 65535 "
    "and a ttl from 0 (this computer) to 255, e.g. udpm://239.255.76.67:7667?ttl=0; or memq://, tcpq://";

struct LcmParameters {
  std::string url;
  std::string channel_prefix;           // channels are PREFIX_STATE, PREFIX_CYCLE, ...
  int state_every_cycles = 1;           // publish every n-th state
  int cycle_every_cycles = 1;           // publish every n-th cycle record; 0: never
  std::string key_file{};               // its key must sign commands; absolute, or relative to the daemon's file
};

struct BlackBoxParameters {             // the last cycles, written out on every fault
  double seconds = 0;
  std::string folder;                   // absolute
};

struct DaemonParameters {
  std::string robot_file;               // absolute, or relative to the daemon's file
  bool commissioning_required = true;   // false, for a simulation: arms a robot that was never commissioned
  bool exchanged_drives_refused = true; // false: a drive with another serial number than recorded is only reported
  ControllerParameters controller;
  BusParameters bus;
  RealtimeParameters realtime;
  LcmParameters lcm;
  std::optional<BlackBoxParameters> black_box;  // none: faults leave no black box
};

}  // namespace tendril
