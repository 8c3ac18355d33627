// One control cycle as data: what came in, every value computed, what goes out. The controller fills it, the gateway
// publishes it, the log keeps it, replay feeds it back. Plain values with fixed capacity: copying never allocates.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string_view>

#include "tendril/core/clock.h"
#include "tendril/core/limits.h"
#include "tendril/core/status.h"

namespace tendril {

// ---- commands ----------------------------------------------------------------------------------------------------

enum class CommandKind : std::uint8_t { kNone, kTip, kBending, kTension, kMode };
enum class ModeRequest : std::uint8_t {
  kArm,
  kDisarm,
  kHold,
  kClear,
  kCommission,      // pull single motors gently, to find out how the robot is wired
  kHome,            // wind slack tendons in, to pretension
  kNotCommissioned,  // arm or home, of a robot that was never commissioned: what the daemon makes of it; refused
  kStop,             // disarm with tensions down within a second: what the daemon makes of being ended
  kNotAlone,         // what the daemon makes of arm, home and commission where another daemon hears them; refused
  kDriveExchanged    // ... of arm and home where a drive is not the one that was commissioned; refused
};

/// A command as it left the gateway. Unused values are empty or zero.
struct Command {
  CommandKind kind = CommandKind::kNone;
  std::uint32_t sequence = 0;           // of the sender, must increase
  std::uint32_t sender = 0;             // a number that is this sender's alone; 0: it has none
  TimeNs received_ns = 0;               // controller's clock, when it arrived at the gateway
  TimeNs valid_for_ns = 0;              // a target is refused when older; a moving one stops when it expires
  ModeRequest mode = ModeRequest::kHold;
  Eigen::Vector3d tip_W_m{0, 0, 0};     // in F_0
  Eigen::Vector3d tip_velocity_W_mps{0, 0, 0};  // target moves on with it until the command expires
  BendingVector bending_rad;            // (us, vs) a section
  BendingVector bending_rate_radps;
  TendonVector tension_N;               // desired at the robot's base; while commissioning of the bare motors, +-
  double speed_radps = 0;               // bending speed towards the target; 0: the configured default
};

// ---- the drives, as the bus shows them -----------------------------------------------------------------------------

enum class DriveState : std::uint8_t {
  kOffline,
  kBooting,
  kReady,
  kEnabled,
  kQuickStop,
  kFault,
  kUnreachable,    // its interface is down or gone; every drive of the bus is
  kOtherDevice,    // its identity is not that of the configuration
  kMisconfigured,  // refused or did not keep its configuration, or has other motor data
  kIdTwice,        // two drives answer with its node id
};
enum class DriveRequest : std::uint8_t { kDisable, kEnable };

/// Raw bus values of one drive. Signs: positive torque and position pull the tendon.
struct DriveFeedback {
  DriveState state = DriveState::kOffline;
  std::uint16_t statusword = 0;         // 0x6041
  std::uint16_t error_code = 0;         // last EMCY code, 0 when none
  std::int32_t position_counts = 0;     // 0x6064
  std::int16_t torque_permille = 0;     // 0x6077, of rated torque
  std::int16_t analog_mV = 0;           // of the load cell: 0x3160:01 of an EPOS4, else analog_input
  std::uint16_t age_cycles = 0;         // 0: arrived in this cycle
};

struct TrackerSample {
  bool valid = false;
  TimeNs time_ns = 0;
  Eigen::Vector3d tip_W_m{0, 0, 0};
  Eigen::Quaterniond orientation_WT{1, 0, 0, 0};
};

struct CycleInput {
  std::uint64_t cycle = 0;
  TimeNs time_ns = 0;                   // start of the cycle on the deadline grid
  bool bus_ok = true;                   // false: bus-off, or the interface is down (drives are kUnreachable)
  bool late = false;                    // the previous cycle missed its deadline
  int drives = 0;                       // number of valid entries below, in tendon order
  std::array<DriveFeedback, kMaxTendons> drive{};
  Command command;                      // kind == kNone: nothing new
  TrackerSample tracker;                // valid only in the cycle in which it is new
};

// ---- what the controller did with it -----------------------------------------------------------------------------

/// What each means: ModeMeaning; how they follow each other: control/supervisor.h.
enum class Mode : std::uint8_t {
  kDisconnected,
  kConfigured,
  kArmed,
  kPretension,
  kRunning,
  kHold,
  kSafeStop,
  kFault,
  kHoming,
  kCommissioning,
};
inline constexpr Mode kLastMode = Mode::kCommissioning;

/// Desired motion of the sections, after limits.
struct BendingReference {
  BendingVector position_rad, velocity_radps, acceleration_radps2;
};

struct CycleOutput {
  std::uint64_t cycle = 0;
  TimeNs time_ns = 0;
  Mode mode = Mode::kDisconnected;
  Status status = Status::kOk;          // the most severe of this cycle; latched in kFault
  DriveRequest drive_request = DriveRequest::kDisable;
  bool clear_drive_faults = false;      // in the one cycle in which the operator's clear was accepted
  std::array<std::int16_t, kMaxTendons> torque_target_permille{};

  // stages, in flow order
  BendingVector target_bending_rad;     // after the gate and inverse kinematics, before the trajectory
  Eigen::Vector3d target_tip_W_m{0, 0, 0};   // asked for; NaN when bending or tensions were commanded
  double target_distance_m = 0;         // from the tip asked for to the nearest reachable one
  BendingReference reference;
  Eigen::Vector3d reference_tip_W_m{0, 0, 0};  // constant-curvature tip of the reference
  BendingVector generalised_force_Nm;   // on the sections, from Kane's equations
  TendonVector tension_desired_base_N;  // allocation
  TendonVector sliding_direction;       // z_c in [-1, 1]: +1 the motor pulls
  TendonVector tension_desired_motor_N; // after Capstan compensation
  TendonVector torque_desired_Nm;       // motor shaft
  TendonVector displacement_desired_m;  // straight-tendon shortening of the reference, pull positive

  // estimate
  TendonVector displacement_m;          // spool pull since pretension, from the encoders
  TendonVector tension_measured_N;      // load cell, where it sits
  TendonVector tension_base_estimate_N; // at the robot's base
  TendonVector torque_measured_Nm;
  BendingVector bending_estimate_rad;
  BendingMatrix bending_covariance_rad2;  // of its error, see control/estimator.h
  Eigen::Vector3d tip_estimate_W_m{0, 0, 0};
  Eigen::Quaterniond orientation_estimate_WT{1, 0, 0, 0};

  // counters since start
  std::uint32_t commands_accepted = 0;
  std::uint32_t commands_refused = 0;
  std::uint32_t feedback_missing = 0;
  Status command_status = Status::kOk;  // why the last command was refused, or Ok

  // The rest is for people and programs above; it is in no cycle message.

  std::array<Status, 8> reported{};     // all that this cycle has to say, as it came up; the rest is kOk
  Eigen::Vector3d nearest_tip_W_m{0, 0, 0};  // to the tip that was refused in this cycle as out of reach
  int blamed_tendon = 0;                // of the fault that began in this cycle, from 1; 0: none, or not known
};

/// Measured by the loop around the controller; not an input of it, so replay stays exact.
struct CycleTiming {
  TimeNs wake_latency_ns = 0;           // actual start less the grid point
  TimeNs feedback_ns = 0;               // SYNC to the last TPDO
  TimeNs compute_ns = 0;                // Controller::Step
  TimeNs total_ns = 0;                  // wake to RPDOs handed to the kernel
  std::uint64_t deadline_misses = 0;    // since start
};

struct CycleRecord {
  CycleInput input;
  CycleOutput output;
  CycleTiming timing;
};

std::string_view ModeText(Mode mode) noexcept;
/// What the drives do in it, in a sentence.
std::string_view ModeMeaning(Mode mode) noexcept;
/// Why nothing can be armed while a drive is in this state; kOk where it is ready or still starting.
Status WhyNotReady(DriveState state) noexcept;

}  // namespace tendril
