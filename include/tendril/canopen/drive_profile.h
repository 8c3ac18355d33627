// A kind of drive as one object: its objects, start-up, PDOs, units and emergency codes. Master and emulator
// take all that is special about a drive from here. To add a kind: a folder in src/canopen/drives and a row
// in drives.cpp.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tendril/canopen/boot_script.h"
#include "tendril/canopen/emcy.h"
#include "tendril/canopen/object_table.h"
#include "tendril/canopen/pdo.h"
#include "tendril/core/daemon.h"

namespace tendril::canopen {

struct DriveProfile;
using DriveProfilePtr = std::shared_ptr<const DriveProfile>;

DriveProfilePtr Epos4Profile();

/// The PDOs that the master maps.
struct DrivePdos {
  PdoLayout torque;    // to the drive: 0x6040 and 0x6071; received before a SYNC, it acts at that SYNC
  PdoLayout feedback;  // at each SYNC: 0x6064, 0x6077, and the load cell where the drive reads one
  PdoLayout status;    // 0x6041
};

/// Settings and checks of one drive, beyond BusParameters.
struct DriveSetup {
  int node_id = 0;
  std::uint32_t nominal_current_mA = 0;
  std::uint32_t output_current_limit_mA = 0;
  std::uint32_t torque_constant_uNmpA = 0;
  std::uint32_t rated_torque_uNm = 0;  // must agree with what 0x6076 reports
  DriveProfilePtr profile = Epos4Profile();
};

struct DriveProfile {
  std::string name;  // "maxon EPOS4"
  std::string file;  // the EDS file that it was made of; empty: none
  ObjectTable objects;
  DrivePdos pdos;
  std::optional<ObjectAddress> analog_input;  // of the load cell
  double analog_mV_per_count = 1;
  std::uint32_t rated_torque_unit_uNm = 1;  // of 0x6076
  const char* rated_torque_source = "";     // what rated_torque_Nm must be, for messages
  const char* identity_source = "";  // where the identity that a drive must have is written, for messages
  std::span<const EmcyInfo> emcy;    // see FindEmcy
  /// Every SDO action of the start-up, in order.
  std::vector<BootAction> (*boot_script)(const DriveProfile& profile, const BusParameters& bus,
                                         const DriveSetup& drive) = nullptr;
};

/// Of the drive that a node of the daemon file is. Throws std::invalid_argument, one line, when its EDS file
/// is none.
DriveProfilePtr ProfileOf(const NodeParameters& node);

/// The emergency codes of a kind of drive, which need no EDS file.
std::span<const EmcyInfo> EmcyOf(DriveKind kind) noexcept;

/// The first thing that the start-up or the cycle needs and the drive's objects do not allow, by object and
/// with the line of its EDS file; empty when the drive can do all of it.
std::string Unsupported(const BusParameters& bus, const DriveSetup& drive);

}  // namespace tendril::canopen
