// Free rotors under the torque of their drives.
// Knows no bus.
#include "tendril/rig/free_motors.h"

#include <fmt/core.h>

#include <algorithm>
#include <bitset>
#include <charconv>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string_view>

#include "tendril/canopen/wire.h"

namespace tendril::rig {
namespace {

constexpr double kLongestStep_s = 1e-3;
constexpr const char* kExample = "accepted: node ids and ranges, for example 4-127 or 4-8,40";

int ParseNode(std::string_view text, const std::string& all) {
  int node = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), node);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) {
    throw std::invalid_argument(fmt::format("'{}' in '{}' is not a node id; {}", text, all, kExample));
  }
  if (node < canopen::kMinNodeId || node > canopen::kMaxNodeId) {
    throw std::invalid_argument(fmt::format("node {} in '{}' is out of range; accepted: {} .. {}", node, all,
                                            canopen::kMinNodeId, canopen::kMaxNodeId));
  }
  return node;
}

}  // namespace

std::vector<int> ParseNodeList(const std::string& text, const std::vector<int>& taken) {
  std::vector<int> nodes;
  std::bitset<canopen::kMaxNodeId + 1> seen;
  for (std::string_view rest = text;;) {
    const std::size_t comma = rest.find(',');
    const std::string_view part = rest.substr(0, comma);
    const std::size_t dash = part.find('-');
    const int first = ParseNode(part.substr(0, dash), text);
    const int last = dash == std::string_view::npos ? first : ParseNode(part.substr(dash + 1), text);
    if (last < first) {
      throw std::invalid_argument(fmt::format("'{}' in '{}' runs backwards; {}", part, text, kExample));
    }
    for (int node = first; node <= last; ++node) {
      if (std::find(taken.begin(), taken.end(), node) != taken.end()) {
        throw std::invalid_argument(
            fmt::format("node {} in '{}' is one of the robot's drives; leave it out", node, text));
      }
      if (seen.test(static_cast<std::size_t>(node))) {
        throw std::invalid_argument(
            fmt::format("node {} in '{}' is given twice; leave it out once", node, text));
      }
      seen.set(static_cast<std::size_t>(node));
      nodes.push_back(node);
    }
    if (comma == std::string_view::npos) return nodes;
    rest.remove_prefix(comma + 1);
  }
}

std::vector<emulator::EmulatedDriveParameters> FreeDrives(const std::vector<int>& nodes,
                                                          const TendonDriveParameters& like) {
  std::vector<emulator::EmulatedDriveParameters> drives;
  for (const int node : nodes) {
    emulator::EmulatedDriveParameters drive;
    drive.node_id = node;
    drive.serial = 1000u + static_cast<std::uint32_t>(node);
    drive.nominal_current_mA = static_cast<std::uint32_t>(std::lround(like.motor.nominal_current_A * 1e3));
    drive.torque_constant_uNmpA =
        static_cast<std::uint32_t>(std::lround(like.motor.torque_constant_NmpA * 1e6));
    drives.push_back(drive);
  }
  return drives;
}

FreeMotors::FreeMotors(emulator::DriveRack& rack, int first, const TendonDriveParameters& like)
    : rack_(rack),
      first_(first),
      parameters_(like.motor),
      counts_per_rad_(like.drive.encoder_counts_per_turn / (2 * std::numbers::pi)),
      motors_(static_cast<std::size_t>(rack.drives() - first)) {}

void FreeMotors::Poll(TimeNs now_ns) {
  const double elapsed_s = now_ns_ < 0 ? 0 : ToSeconds(now_ns - now_ns_);
  now_ns_ = now_ns;
  const int steps = std::max(1, static_cast<int>(std::ceil(elapsed_s / kLongestStep_s)));
  const double step_s = elapsed_s / steps;
  const double per_Nm_radps = step_s / parameters_.rotor_inertia_kgm2;
  for (std::size_t i = 0; i < motors_.size(); ++i) {
    Motor& motor = motors_[i];
    const int drive = first_ + static_cast<int>(i);
    const double torque_Nm = rack_.torque_Nm(drive);
    if (torque_Nm != 0 || motor.velocity_radps != 0) {
      for (int k = 0; k < steps; ++k) {
        // Friction is taken at the step's end, which is stable for any rotor.
        const double driven_radps = (motor.velocity_radps + torque_Nm * per_Nm_radps) /
                                    (1 + parameters_.viscous_friction_Nms * per_Nm_radps);
        const double lost_radps = parameters_.coulomb_friction_Nm * per_Nm_radps;
        motor.velocity_radps = driven_radps - std::clamp(driven_radps, -lost_radps, lost_radps);
        motor.counts += motor.velocity_radps * step_s * counts_per_rad_;
      }
    }
    emulator::DriveSensors shown;
    // The counter wraps as the drive's does.
    shown.position_counts = static_cast<std::int32_t>(
        static_cast<std::uint32_t>(static_cast<std::int64_t>(std::floor(motor.counts))));
    constexpr double kMost_rpm = 1e9;
    shown.velocity_rpm = static_cast<std::int32_t>(
        std::lround(std::clamp(motor.velocity_radps * 60 / (2 * std::numbers::pi), -kMost_rpm, kMost_rpm)));
    shown.actual_torque_Nm = torque_Nm;
    rack_.SetSensors(drive, shown);
  }
}

}  // namespace tendril::rig
