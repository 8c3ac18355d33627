// Connects plant and drives: sensors one way, torque the other. Knows nothing of the controller and of where
// frames come from.
#include "tendril/rig/virtual_rig.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace tendril::rig {
namespace {

std::vector<emulator::EmulatedDriveParameters> Drives(
    const RobotParameters& robot, const DriveProfiles& profiles,
    std::span<const emulator::EmulatedDriveParameters> more) {
  std::vector<emulator::EmulatedDriveParameters> drives;
  for (const int j : robot.actuation->DrivenTendons()) {
    const TendonDriveParameters& tendon = robot.actuation->tendons[static_cast<std::size_t>(j)];
    emulator::EmulatedDriveParameters drive;
    drive.node_id = tendon.node_id;
    drive.serial = static_cast<std::uint32_t>(drives.size() + 1);
    drive.nominal_current_mA = static_cast<std::uint32_t>(std::lround(tendon.motor.nominal_current_A * 1e3));
    drive.torque_constant_uNmpA =
        static_cast<std::uint32_t>(std::lround(tendon.motor.torque_constant_NmpA * 1e6));
    drive.profile = profiles.Of(drive.node_id);
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

DriveProfiles::DriveProfiles(std::span<const NodeParameters> nodes) {
  for (const NodeParameters& node : nodes) profiles_[node.node_id] = canopen::ProfileOf(node);
}

canopen::DriveProfilePtr DriveProfiles::Of(int node_id) const {
  const auto at = profiles_.find(node_id);
  return at == profiles_.end() ? canopen::Epos4Profile() : at->second;
}

// The plant comes first: it refuses a robot without actuation.
VirtualRig::VirtualRig(const RobotParameters& robot, can::CanPort& port, const sim::PlantOptions& options,
                       const DriveProfiles& profiles, std::span<const emulator::EmulatedDriveParameters> more)
    : robot_(robot),
      plant_(robot_, options),
      rack_(Drives(robot_, profiles, more), port),
      tendon_of_(robot_.actuation->DrivenTendons()),
      released_(tendon_of_.size(), false),
      torque_Nm_(plant_.tendons()),
      wiring_(released_.size()),
      empty_(released_.size()) {
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
    TurnEmptySpools(ToSeconds(ahead_ns));
    ShowSensors();
  }
  const int syncs = rack_.Poll(now_ns);
  bool changed = false;
  for (std::size_t i = 0; i < tendon_of_.size(); ++i) {
    const int j = tendon_of_[i], drive = static_cast<int>(i);
    const Wiring& wiring = wiring_[i];
    released_[i] = released_[i] || (rack_.enabled(drive) && !brakes_held_);
    double torque = released_[i] ? rack_.torque_Nm(drive) : torque_Nm_[j];
    if (wiring.motor_reversed && released_[i]) torque = -torque;
    if (wiring.tendon_off) {
      empty_[i].torque_Nm = torque;
      torque = 0;
    }
    if (wiring.jammed) torque = torque_Nm_[j];
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
                       .time_ns = *start_ns_ + now_ns,
                       .tip_W_m = reading.tip_W_m,
                       .orientation_WT = reading.orientation_WT};
}

// A rotor under friction, nothing else.
void VirtualRig::TurnEmptySpools(double seconds) {
  for (std::size_t j = 0; j < wiring_.size(); ++j) {
    if (!wiring_[j].tendon_off) continue;
    const MotorParameters& motor = robot_.actuation->tendons[static_cast<std::size_t>(tendon_of_[j])].motor;
    EmptySpool& spool = empty_[j];
    const double friction_Nm =
        motor.coulomb_friction_Nm + motor.viscous_friction_Nms * std::abs(spool.velocity_radps);
    const double driven_radps = spool.velocity_radps + spool.torque_Nm / motor.rotor_inertia_kgm2 * seconds;
    const double lost_radps = friction_Nm / motor.rotor_inertia_kgm2 * seconds;
    spool.velocity_radps = driven_radps - std::clamp(driven_radps, -lost_radps, lost_radps);
    spool.angle_rad += spool.velocity_radps * seconds;
  }
}

void VirtualRig::ShowSensors() {
  const auto sensors = plant_.ReadSensors();
  for (std::size_t i = 0; i < tendon_of_.size(); ++i) {
    const int j = tendon_of_[i];
    const Wiring& wiring = wiring_[i];
    const TendonDriveParameters& t = robot_.actuation->tendons[static_cast<std::size_t>(j)];
    emulator::DriveSensors shown;
    shown.position_counts = sensors[j].encoder_counts;
    double velocity_radps = plant_.tendon()[j].motor_velocity_radps;
    shown.actual_torque_Nm = sensors[j].torque_Nm;
    const int of = wiring.cell_of < 0 ? j : tendon_of_[static_cast<std::size_t>(wiring.cell_of)];
    double cell_V = sensors[of].load_cell_V;
    if (wiring_[wiring.cell_of < 0 ? i : static_cast<std::size_t>(wiring.cell_of)].tendon_off) {
      // Without a tendon the cell's reading is its noise and zero.
      const auto& cell = t.load_cell;
      const auto& tendon = plant_.tendon()[of];
      cell_V -= cell.gain_VpN *
                (cell.place == LoadCellPlace::kRobotSide ? tendon.tension_base_N : tendon.tension_motor_N);
    }
    if (wiring.tendon_off) {
      const EmptySpool& spool = empty_[i];
      shown.position_counts += static_cast<std::int32_t>(
          std::lround(spool.angle_rad / (2 * std::numbers::pi) * t.drive.encoder_counts_per_turn));
      velocity_radps = spool.velocity_radps;
      shown.actual_torque_Nm = sensors[j].torque_Nm + spool.torque_Nm;
    }
    if (wiring.jammed) shown.actual_torque_Nm = rack_.torque_Nm(static_cast<int>(i));
    if (wiring.motor_reversed && released_[i]) shown.actual_torque_Nm = -shown.actual_torque_Nm;
    if (wiring.encoder_reversed) {
      shown.position_counts = -shown.position_counts;
      velocity_radps = -velocity_radps;
    }
    if (wiring.encoder_dead) shown.position_counts = 0;
    shown.velocity_rpm = static_cast<std::int32_t>(std::lround(velocity_radps * 60 / (2 * std::numbers::pi)));
    cell_V = wiring.cell_gain == 0 ? 0 : wiring.cell_gain * cell_V;
    shown.analog_mV[0] = Millivolts(cell_V + 1e-3 * wiring.cell_zero_mV);
    rack_.SetSensors(static_cast<int>(i), shown);
  }
}

}  // namespace tendril::rig
