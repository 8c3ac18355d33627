// A fault and a scenario, key by key: which keys each kind of fault has, and their accepted ranges.
// Used with Reader only, for nothing writes them back; knows nothing of drives.
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

/// Reads a key that may be left out.
template <class Read>
void Optional(Reader& in, std::string_view key, Read read) {
  if (in.Has(key)) {
    read();
  } else {
    in.Allow(key);
  }
}

inline void Describe(Reader& in, FaultParameters& p) {
  in.Choice("fault", p.kind,
            Choices<FaultKind>{{"drop", FaultKind::kDrop},
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
                               {"bus_off", FaultKind::kBusOff}});
  Optional(in, "at_s", [&] { in.Number("at_s", p.at_s, {0, 1e6}); });

  const auto duration = [&] { Optional(in, "for_s", [&] { in.Number("for_s", p.for_s, {0, 1e6, true}); }); };
  const auto drive = [&] { in.Integer("node", p.node, {1, 127}); };
  switch (p.kind) {
    case FaultKind::kDelay:
      in.Number("delay_s", p.delay_s, {0, 10, true});
      [[fallthrough]];
    case FaultKind::kDrop:
    case FaultKind::kDuplicate:
    case FaultKind::kCorrupt:
      duration();
      Optional(in, "node", drive);
      Optional(in, "direction", [&] {
        in.Choice("direction", p.direction,
                  Choices<FrameDirection>{{"both", FrameDirection::kBoth},
                                          {"to_drives", FrameDirection::kToDrives},
                                          {"from_drives", FrameDirection::kFromDrives}});
      });
      Optional(in, "cob_id", [&] { in.Integer("cob_id", p.cob_id.emplace(), {0, 0x7FF}); });
      Optional(in, "probability", [&] { in.Number("probability", p.probability, {0, 1, true}); });
      Optional(in, "count", [&] { in.Integer("count", p.count, {1, 1e9}); });
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
      in.Integer("code", p.code, {0, 0xFFFF});
      return;
    case FaultKind::kStickSensor:
      drive();
      in.Choice("sensor", p.sensor,
                Choices<DriveSensor>{{"encoder", DriveSensor::kEncoder},
                                     {"load_cell", DriveSensor::kLoadCell},
                                     {"torque", DriveSensor::kTorque}});
      duration();
      return;
    case FaultKind::kSto:
      Optional(in, "node", drive);
      duration();
      return;
    case FaultKind::kBusOff:
      duration();
      return;
  }
}

inline void Describe(Reader& in, Scenario& p) { in.List("faults", p.faults, {1, 1000}); }

}  // namespace tendril::config
