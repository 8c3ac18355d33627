// The record that a robot is wired as its files say: what it covers, where it lies, how it is read and
// written. Knows nothing of how it is found out.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::daemon {

/// Sixteen hexadecimal digits of all that commissioning checks: nodes and their tendons, directions, and of
/// each tendon's drive what turns bus values into newtons and metres, and its hole's angle.
std::string WiringHash(const RobotParameters& robot, const BusParameters& bus);

/// Beside the robot file: its name and ".commissioned".
std::string RecordPath(const DaemonParameters& daemon);

/// What was found of one tendon; NaN: not measured.
struct CommissionedTendon {
  int node_id = 0, tendon = 0;
  std::uint32_t serial = 0;   // of the drive, 0x1018:04; 0: not known
  double cell_zero_N = 0;     // shown by a slack tendon
  double cell_gain = 0;       // of the file's
  double slack_m = 0;         // wound in until the tendon was taut
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

/// Empty when there is a record of exactly this wiring, or none is required; else one line: what is missing.
std::string CommissioningProblem(const RobotParameters& robot, const DaemonParameters& daemon);

/// Empty when every drive has the serial number that the record has for its node, or no record is required;
/// else one line: which has not. `serials` in tendon order, 0: not read yet. A drive without a serial
/// number in the record may be any; see UnnumberedDrives.
std::string ExchangedDrives(const DaemonParameters& daemon, std::span<const std::uint32_t> serials);

/// Empty when the record, where one is required and there, has a serial number for every drive; else one
/// line: for which it has not.
std::string UnnumberedDrives(const DaemonParameters& daemon);

}  // namespace tendril::daemon
