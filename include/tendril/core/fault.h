// A fault to be acted out on the emulated side: what, when, for whom. Plain numbers with units, filled by
// config/; knows neither bus nor drive.
#pragma once

#include <cstdint>
#include <optional>

namespace tendril {

enum class FaultKind : std::uint8_t {
  // frames between the bus and the emulated drives
  kDrop,
  kDelay,
  kDuplicate,
  kCorrupt,  // one bit of the data is inverted, as by a fault that CAN's checksum does not see
  // a drive
  kDie,            // its supply goes: deaf, mute and without torque; afterwards it boots
  kReboot,         // off and on again
  kFreeze,         // deaf and mute with its last torque
  kEmcy,           // it detects the error behind a code
  kStopHeartbeat,  // until its next reset
  kStickSensor,    // one of its sensors keeps its value
  kSto,            // safe torque off, as by an emergency stop; without a node of every drive
  // the bus
  kBusOff,  // for everybody on it
};

enum class FrameDirection : std::uint8_t { kBoth, kToDrives, kFromDrives };
enum class DriveSensor : std::uint8_t { kEncoder, kLoadCell, kTorque };

struct FaultParameters {
  FaultKind kind = FaultKind::kDrop;
  double at_s = 0;   // after it was ordered
  double for_s = 0;  // 0: to the end
  int node = 0;      // the drive; of frame faults the node in the COB-ID, 0: every frame

  // Which frames; one of all those that fit is taken with `probability`, until `count` were (0: no end).
  FrameDirection direction = FrameDirection::kBoth;
  std::optional<std::uint32_t> cob_id = std::nullopt;
  double probability = 1;
  std::int64_t count = 0;

  double delay_s = 0;                          // kDelay
  std::uint16_t code = 0;                      // kEmcy
  DriveSensor sensor = DriveSensor::kEncoder;  // kStickSensor
};

}  // namespace tendril
