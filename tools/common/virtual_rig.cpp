// Plant and drives joined: sensors one way, torque the other.
// Knows nothing of the controller and of where frames come from.
#include "virtual_rig.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace tendril::tools {
namespace {

std::vector<emulator::EmulatedDriveParameters> Drives(
    const RobotParameters& robot, std::span<const emulator::EmulatedDriveParameters> more) {
  std::vector<emulator::EmulatedDriveParameters> drives;
  for (const auto& tendon : robot.actuation->tendons) {
    emulator::EmulatedDriveParameters drive;
    drive.node_id = tendon.node_id;
    drive.serial = static_cast<std::uint32_t>(drives.size() + 1);
    drive.nominal_current_mA = static_cast<std::uint32_t>(std::lround(tendon.motor.nominal_current_A * 1e3));
    drive.torque_constant_uNmpA =
        static_cast<std::uint32_t>(std::lround(tendon.motor.torque_constant_NmpA * 1e6));
    drives.push_back(drive);
  }
  drives.insert(drives.end(), more.begin(), more.end());
  return drives;
}

std::int16_t Millivolts(double volts) {
  constexpr double kMost = std::numeric_limits<std::int16_t>::max();
  return static_cast<std::int16_t>(std::lround(std::clamp(volts * 1e3, -kMost, kMost)));
}

}  // namespace

// The plant comes first: it refuses a robot without actuation.
VirtualRig::VirtualRig(const RobotParameters& robot, can::CanPort& port, const sim::PlantOptions& options,
                       std::span<const emulator::EmulatedDriveParameters> more)
    : robot_(robot),
      plant_(robot_, options),
      rack_(Drives(robot_, more), port),
      released_(robot_.actuation->tendons.size(), false),
      torque_Nm_(plant_.tendons()) {
  for (int j = 0; j < plant_.tendons(); ++j) torque_Nm_[j] = plant_.tendon()[j].motor_torque_Nm;
}

int VirtualRig::Poll(TimeNs now_ns) {
  if (!start_ns_) {
    start_ns_ = now_ns;
    ShowSensors();
  }
  const TimeNs ahead_ns = now_ns - *start_ns_ - plant_.time_ns();
  if (ahead_ns > 0) {
    plant_.Advance(ahead_ns);
    ShowSensors();
  }
  const int syncs = rack_.Poll(now_ns);
  bool changed = false;
  for (int j = 0; j < plant_.tendons(); ++j) {
    released_[j] = released_[j] || (rack_.enabled(j) && !brakes_held_);
    const double torque = released_[j] ? rack_.torque_Nm(j) : torque_Nm_[j];
    changed = changed || torque != torque_Nm_[j];
    torque_Nm_[j] = torque;
  }
  if (changed) plant_.SetTorque(torque_Nm_);
  return syncs;
}

std::optional<TrackerSample> VirtualRig::TakeTrackerReading() {
  const auto& tracker = robot_.actuation->tracker;
  const TimeNs now_ns = plant_.time_ns();
  if (!tracker || !start_ns_ || now_ns < next_reading_ns_) return std::nullopt;
  next_reading_ns_ =
      std::max(next_reading_ns_ + static_cast<TimeNs>(std::llround(1e9 / tracker->rate_Hz)), now_ns);
  const sim::TrackerReading reading = plant_.ReadTracker();
  return TrackerSample{.valid = true,
                       .time_ns = *start_ns_ + now_ns - std::llround(tracker->delay_s * 1e9),
                       .tip_W_m = reading.tip_W_m,
                       .orientation_WT = reading.orientation_WT};
}

void VirtualRig::ShowSensors() {
  const auto sensors = plant_.ReadSensors();
  for (int j = 0; j < plant_.tendons(); ++j) {
    emulator::DriveSensors shown;
    shown.position_counts = sensors[j].encoder_counts;
    shown.velocity_rpm = static_cast<std::int32_t>(
        std::lround(plant_.tendon()[j].motor_velocity_radps * 60 / (2 * std::numbers::pi)));
    shown.actual_torque_Nm = sensors[j].torque_Nm;
    shown.analog_mV[0] = Millivolts(sensors[j].load_cell_V);
    rack_.SetSensors(j, shown);
  }
}

}  // namespace tendril::tools
