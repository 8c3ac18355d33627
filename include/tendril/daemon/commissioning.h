// The record that a robot is wired as its files state: contents, location, reading and writing. Knows nothing
// of how the wiring is checked.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::daemon {

/// Hash in sixteen hexadecimal digits of all that commissioning checks: nodes and their tendons, directions,
/// and per tendon the drive's scaling to newtons and metres and the hole's angle.
std::string WiringHash(const RobotParameters& robot, const BusParameters& bus);

/// Beside the robot file: its name and ".commissioned".
std::string RecordPath(const DaemonParameters& daemon);

/// Results for one tendon; NaN: not measured.
struct CommissionedTendon {
  int node_id = 0, tendon = 0;
  std::uint32_t serial = 0;   // of the drive, 0x1018:04; 0: not known
  double cell_zero_N = 0;     // reading of the slack tendon
  double cell_gain = 0;       // relative to the file's
  double slack_m = 0;         // travel until the tendon was taut
  double seen_angle_rad = 0;  // direction in which its pull bent the robot, base frame
};

struct CommissioningRecord {
  std::string wiring;            // hash
  std::string at, by, software;  // UTC, user@host, version
  double pull_N = 0;
  std::vector<CommissionedTendon> tendons;
};

/// Throws std::runtime_error with the remedy when the file cannot be written.
void WriteRecord(const std::string& path, const CommissioningRecord& record);

/// Empty when a record of exactly this wiring exists or none is required; else one line with what is missing.
std::string CommissioningProblem(const RobotParameters& robot, const DaemonParameters& daemon);

/// Empty when every drive has the serial number recorded for its node, or no record is required; else one
/// line naming those that differ. `serials` in tendon order, 0: not read yet. A drive without a recorded
/// serial number is not checked; see UnnumberedDrives.
std::string ExchangedDrives(const DaemonParameters& daemon, std::span<const std::uint32_t> serials);

/// Empty when the record, if required and present, has a serial number for every drive; else one line naming
/// the drives without.
std::string UnnumberedDrives(const DaemonParameters& daemon);

}  // namespace tendril::daemon
