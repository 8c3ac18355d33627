// The commissioning record; see the header.
#include "tendril/daemon/commissioning.h"

#include <fmt/format.h>

#include <algorithm>
#include <cinttypes>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <vector>

#include "tendril/config/whole_file.h"

namespace tendril::daemon {
namespace {

constexpr const char* kWiringKey = "wiring: ";
// Start of a tendon's line, as written by WriteRecord.
constexpr const char* kTendonLine = " - {tendon: %d, node_id: %d, serial: %" SCNd64 ",";

// The drives of a record; none without a record. Impossible numbers are left out.
std::vector<CommissionedTendon> RecordedDrives(const DaemonParameters& daemon) {
  std::vector<CommissionedTendon> drives;
  if (!daemon.commissioning_required) return drives;
  std::ifstream file(RecordPath(daemon));
  for (std::string line; std::getline(file, line);) {
    CommissionedTendon t;
    std::int64_t serial = 0;
    if (std::sscanf(line.c_str(), kTendonLine, &t.tendon, &t.node_id, &serial) != 3) continue;
    if (serial < 0 || serial > std::numeric_limits<std::uint32_t>::max()) continue;
    t.serial = static_cast<std::uint32_t>(serial);
    drives.push_back(t);
  }
  return drives;
}

// What is wrong with the drives of a record whose wiring matches; empty: each tendon is there once, at its
// node.
std::string Damage(const DaemonParameters& daemon) {
  const std::vector<CommissionedTendon> drives = RecordedDrives(daemon);
  for (const NodeParameters& n : daemon.bus.nodes) {
    const auto of_tendon = [&](const CommissionedTendon& t) { return t.tendon == n.tendon; };
    const auto found = std::find_if(drives.begin(), drives.end(), of_tendon);
    if (found == drives.end()) return fmt::format("tendon {} is not there", n.tendon);
    if (std::count_if(drives.begin(), drives.end(), of_tendon) > 1)
      return fmt::format("tendon {} is there more than once", n.tendon);
    if (found->node_id != n.node_id)
      return fmt::format("tendon {} has node {}, not {}", n.tendon, found->node_id, n.node_id);
  }
  return {};
}

std::string Number(double value) { return std::isnan(value) ? ".nan" : fmt::format("{:.4g}", value); }

}  // namespace

std::string WiringHash(const RobotParameters& robot, const BusParameters& bus) {
  std::string text = robot.name + "\n";
  for (const NodeParameters& n : bus.nodes) {
    text += fmt::format("{} {} {} {}\n", n.node_id, n.tendon, n.motor_reversed, n.encoder_reversed);
    if (n.profile != DriveKind::kEpos4)
      text += fmt::format("{} {:.9g}\n", n.analog_input, n.analog_mV_per_count);
  }
  for (const SectionParameters& s : robot.body.sections) {
    text += fmt::format("{} {:.9g}\n", s.units, s.unit_length_m);
    for (const TendonRoute& r : s.tendons) text += fmt::format("{:.9g} {:.9g}\n", r.angle_rad, r.radius_m);
  }
  for (const TendonDriveParameters& t : robot.actuation->tendons) {
    text += fmt::format("{:.9g} {:.9g} {:.9g} {} {:.9g} {:.9g} {} {:.9g} {:.9g}\n",
                        t.motor.torque_constant_NmpA, t.motor.torque_scale, t.drive.rated_torque_Nm,
                        t.drive.encoder_counts_per_turn, t.gear.ratio, t.spool.radius_m,
                        static_cast<int>(t.load_cell.place), t.load_cell.gain_VpN, t.load_cell.offset_N);
  }
  std::uint64_t hash = 0xcbf29ce484222325u;  // FNV-1a
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  return fmt::format("{:016x}", hash);
}

std::string RecordPath(const DaemonParameters& daemon) { return daemon.robot_file + ".commissioned"; }

void WriteRecord(const std::string& path, const CommissioningRecord& record) {
  std::string text = fmt::format(
      "# Written by `tendril commission`; tendrild arms this robot only while `wiring` fits its files.\n"
      "{}{}\nat: {}\nby: \"{}\"\nsoftware: \"{}\"\npull_N: {}\ntendons:\n",
      kWiringKey, record.wiring, record.at, record.by, record.software, Number(record.pull_N));
  for (const CommissionedTendon& t : record.tendons) {
    text += fmt::format(
        "  - {{tendon: {}, node_id: {}, serial: {}, cell_zero_N: {}, cell_gain: {}, slack_m: {}, "
        "seen_angle_rad: {}}}\n",
        t.tendon, t.node_id, t.serial, Number(t.cell_zero_N), Number(t.cell_gain), Number(t.slack_m),
        Number(t.seen_angle_rad));
  }
  // Written as a whole: a partial file must not allow arming.
  config::WriteWhole(path, text);
}

std::string CommissioningProblem(const RobotParameters& robot, const DaemonParameters& daemon) {
  if (!daemon.commissioning_required) return {};
  constexpr const char* kRemedy =
      "nothing arms it before `tendril commission --config FILE` has passed (a simulation: tendrild "
      "--simulated)";
  const std::string path = RecordPath(daemon);
  std::ifstream file(path);
  if (!file) return fmt::format("{} was never commissioned: {} is not there; {}", robot.name, path, kRemedy);
  const std::string expected = kWiringKey + WiringHash(robot, daemon.bus);
  bool names_wiring = false;
  for (std::string line; std::getline(file, line);) {
    names_wiring = names_wiring || line.starts_with(kWiringKey);
    if (line != expected) continue;
    const std::string damage = Damage(daemon);
    if (damage.empty()) return {};
    return fmt::format("{} is damaged: {}; {}", path, damage, kRemedy);
  }
  if (!names_wiring) return fmt::format("{} is damaged: it names no wiring; {}", path, kRemedy);
  return fmt::format(
      "{} was commissioned with other nodes, directions, motors or load cells than its files name now ({}); "
      "{}",
      robot.name, path, kRemedy);
}

std::string ExchangedDrives(const DaemonParameters& daemon, std::span<const std::uint32_t> serials) {
  std::string found;
  for (const CommissionedTendon& t : RecordedDrives(daemon)) {
    if (t.serial == 0 || t.tendon < 1 || static_cast<std::size_t>(t.tendon) > serials.size()) continue;
    const std::uint32_t now = serials[static_cast<std::size_t>(t.tendon) - 1];
    if (now == t.serial) continue;
    found += fmt::format("{}node {} (tendon {}) has serial {}, commissioned was {}",
                         found.empty() ? "" : ", ", t.node_id, t.tendon, now, t.serial);
  }
  if (found.empty()) return {};
  return fmt::format(
      "{} ({}): a drive was exchanged; run `tendril commission --config FILE` again, or put it back "
      "(exchanged_drives: warn in the daemon's file lets it arm)",
      found, RecordPath(daemon));
}

std::string UnnumberedDrives(const DaemonParameters& daemon) {
  std::string found;
  for (const CommissionedTendon& t : RecordedDrives(daemon)) {
    if (t.serial == 0)
      found += fmt::format("{}node {} (tendon {})", found.empty() ? "" : ", ", t.node_id, t.tendon);
  }
  if (found.empty()) return {};
  return fmt::format(
      "{} has no serial number in {}: another drive in its place would not be noticed; run `tendril "
      "commission --config FILE` again (a drive whose object 0x1018:04 is 0 has none)",
      found, RecordPath(daemon));
}

}  // namespace tendril::daemon
