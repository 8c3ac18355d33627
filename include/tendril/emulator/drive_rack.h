// Emulated drives, EPOS4 or of another profile, on one CanPort: object dictionary, SDO server, PDOs,
// heartbeat, CiA 402 state machine. Sensor values are inputs, torque commands outputs; time is passed in.
// Knows nothing of the robot behind the motors.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "tendril/can/can_port.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/core/clock.h"
#include "tendril/core/fault.h"

namespace tendril::emulator {

struct EmulatedDriveParameters {
  int node_id = 1;
  std::optional<std::uint32_t> product_code{}, revision{};  // none: as the profile's objects have them
  std::uint32_t serial = 1;
  std::uint32_t nominal_current_mA = 0;
  std::uint32_t torque_constant_uNmpA = 0;
  canopen::DriveProfilePtr profile = canopen::Epos4Profile();
};

/// Readings of the drive's sensors, set before Poll.
struct DriveSensors {
  std::int32_t position_counts = 0;
  std::int32_t velocity_rpm = 0;
  double actual_torque_Nm = 0;              // from the current, motor shaft
  std::array<std::int16_t, 2> analog_mV{};  // of the load cell (0x3160:01, or analog_input), and 0x3160:02
};

class DriveRack {
 public:
  /// Sends each drive's boot-up message at the first Poll. Throws std::invalid_argument on a node id outside
  /// 1..127 or used twice. Zero motor data keep the drive's factory values; the output current limit starts
  /// at twice the nominal current.
  DriveRack(std::span<const EmulatedDriveParameters> drives, can::CanPort& port);
  ~DriveRack();

  int drives() const noexcept;
  /// The node id in use: a stored 0x2000 takes effect at the next reset.
  int node_id(int drive) const noexcept;
  void SetSensors(int drive, const DriveSensors& sensors) noexcept;
  /// Handles all waiting frames and all actions due at `now_ns`. Returns the number of SYNCs handled. At SYNC
  /// the torque received since the last SYNC becomes the command, and the TPDOs are sampled from the latest
  /// sensor values.
  int Poll(TimeNs now_ns);
  /// Present torque command [N·m at the motor shaft]; zero unless operation is enabled, limited by the
  /// current limit.
  double torque_Nm(int drive) const noexcept;
  /// True in operation enabled (or quick stop active with torque).
  bool enabled(int drive) const noexcept;

  // ---- faults on demand ----

  /// The drive detects the error of a code of its profile: history, EMCY message and reaction. The cause ends
  /// at once, so a fault reset works.
  void InjectEmcy(int drive, std::uint16_t code);
  /// No reception or transmission, with the last torque held, as with a hung processor; frames meanwhile are
  /// lost to it.
  void SetFrozen(int drive, bool frozen) noexcept;
  /// Off and on again: stored values, no torque, boot-up message at the next Poll. Ends freezing and
  /// heartbeat silence, and restores the supply.
  void PowerCycle(int drive) noexcept;
  /// Off: no reception, transmission or torque. On again: as after PowerCycle.
  void SetSupply(int drive, bool on) noexcept;
  /// The sensor keeps its present value until released. (Load cell: both analog inputs.)
  void StickSensor(int drive, DriveSensor sensor, bool stuck) noexcept;
  /// Safe torque off: while active, no torque, no enabling, no fault reset; it outlasts power cycles.
  void SetSto(int drive, bool active);
  /// Stops the heartbeats until the drive is reset; all else works.
  void StopHeartbeat(int drive) noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::emulator
