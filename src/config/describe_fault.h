// A fault and a scenario, key by key: the keys of each kind of fault and their accepted ranges. Used with
// Reader and Lister only, since they are never written back; knows nothing of drives.
#pragma once

#include <string_view>
#include <utility>
#include <vector>

#include "reader.h"
#include "tendril/core/fault.h"

namespace tendril::config {

struct Scenario {
  std::vector<FaultParameters> faults;
};

/// Reads a key that may be omitted; `otherwise` describes the default.
template <class Io, class Read>
void Optional(Io& in, std::string_view key, std::string_view otherwise, Read read) {
  if constexpr (Io::kReading) {
    if (!in.Has(key)) return in.Allow(key);
  } else {
    in.MayBeLeftOut(otherwise);
  }
  read();
}

inline const Choices<FaultKind> kFaultKinds{{"drop", FaultKind::kDrop},
                                                {"delay", FaultKind::kDelay},
                                                {"duplicate", FaultKind::kDuplicate},
                                                {"corrupt", FaultKind::kCorrupt},
                                                {"die", FaultKind::kDie},
                                                {"reboot", FaultKind::kReboot},
                                                {"freeze", FaultKind::kFreeze},
                                                {"emcy", FaultKind::kEmcy},
                                                {"stop_heartbeat", FaultKind::kStopHeartbeat},
                                                {"stick_sensor", FaultKind::kStickSensor},
                                                {"sto", FaultKind::kSto},
                                                {"bus_off", FaultKind::kBusOff}};

constexpr std::string_view MeaningOf(FaultKind kind) {
  switch (kind) {
    case FaultKind::kDrop:
      return "Frames between the bus and the drives are lost.";
    case FaultKind::kDelay:
      return "Frames arrive later.";
    case FaultKind::kDuplicate:
      return "Frames arrive twice.";
    case FaultKind::kCorrupt:
      return "One bit of the data is inverted, as by an error that CAN's checksum does not detect.";
    case FaultKind::kDie:
      return "The drive loses its supply: it answers nothing and has no torque; afterwards it boots.";
    case FaultKind::kReboot:
      return "The drive is switched off and on again.";
    case FaultKind::kFreeze:
      return "The drive answers nothing and keeps its last torque.";
    case FaultKind::kEmcy:
      return "The drive detects the error behind an emergency code.";
    case FaultKind::kStopHeartbeat:
      return "The drive sends no heartbeat until its next reset.";
    case FaultKind::kStickSensor:
      return "One of the drive's sensors keeps its value.";
    case FaultKind::kSto:
      return "Safe torque off, as by an emergency stop.";
    case FaultKind::kBusOff:
      return "The CAN interface goes bus-off, for everybody on it.";
  }
  return "";
}

template <class Io>
void Describe(Io& in, FaultParameters& p) {
  in.Choice("fault", p.kind, kFaultKinds, "Kind of fault.");
  Optional(in, "at_s", "0", [&] {
    in.Number("at_s", p.at_s, {0, 1e6}, "Begin, from the start of the plant or the arrival of the order.");
  });

  const auto duration = [&] {
    Optional(in, "for_s", "for ever", [&] { in.Number("for_s", p.for_s, {0, 1e6, true}, "Duration."); });
  };
  const auto drive = [&] { in.Integer("node", p.node, {1, 127}, "The drive."); };
  switch (p.kind) {
    case FaultKind::kDelay:
      in.Number("delay_s", p.delay_s, {0, 10, true}, "Delay of each frame.");
      [[fallthrough]];
    case FaultKind::kDrop:
    case FaultKind::kDuplicate:
    case FaultKind::kCorrupt:
      duration();
      Optional(in, "node", "all drives", drive);
      Optional(in, "direction", "both", [&] {
        in.Choice("direction", p.direction,
                  Choices<FrameDirection>{{"both", FrameDirection::kBoth},
                                          {"to_drives", FrameDirection::kToDrives},
                                          {"from_drives", FrameDirection::kFromDrives}},
                  "Direction of the frames.");
      });
      Optional(in, "cob_id", "any", [&] {
        in.Integer("cob_id", p.cob_id.emplace(), {0, 0x7FF}, "Only frames of this identifier.");
      });
      Optional(in, "probability", "1", [&] {
        in.Number("probability", p.probability, {0, 1, true}, "Share of the frames that the fault takes.");
      });
      Optional(in, "count", "no end", [&] {
        in.Integer("count", p.count, {1, 1e9}, "Number of frames after which the fault ends.");
      });
      return;
    case FaultKind::kDie:
    case FaultKind::kFreeze:
      drive();
      duration();
      return;
    case FaultKind::kReboot:
    case FaultKind::kStopHeartbeat:
      drive();
      return;
    case FaultKind::kEmcy:
      drive();
      in.Integer("code", p.code, {0, 0xFFFF}, "Emergency error code that the drive sends.");
      return;
    case FaultKind::kStickSensor:
      drive();
      in.Choice("sensor", p.sensor,
                Choices<DriveSensor>{{"encoder", DriveSensor::kEncoder},
                                     {"load_cell", DriveSensor::kLoadCell},
                                     {"torque", DriveSensor::kTorque}},
                "The sensor that keeps its value.");
      duration();
      return;
    case FaultKind::kSto:
      Optional(in, "node", "all drives", drive);
      duration();
      return;
    case FaultKind::kBusOff:
      duration();
      return;
  }
}

template <class Io>
void Describe(Io& in, Scenario& p) {
  in.List("faults", p.faults, {1, 1000}, "The faults, in any order.");
}

}  // namespace tendril::config
