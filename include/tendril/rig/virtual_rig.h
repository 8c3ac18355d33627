// The rig without hardware: emulated drives on a CAN port, and the plant behind their motors. Time is passed
// in, so the same rig runs in simulated time and in real time. Knows nothing of the controller.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <vector>

#include "tendril/can/can_port.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/emulator/drive_rack.h"
#include "tendril/sim/plant.h"

namespace tendril::rig {

/// Wiring faults of one drive.
struct Wiring {
  bool motor_reversed = false;    // motor leads swapped: positive torque pays out
  bool encoder_reversed = false;  // its channels swapped
  bool encoder_dead = false;
  bool tendon_off = false;  // the motor turns an empty spool
  bool jammed = false;      // the motor does not turn
  double cell_gain = 1;     // reading over true value; 0: it always reads zero_mV
  double cell_zero_mV = 0;  // added to the cell's reading
  int cell_of = -1;         // the cell on this drive's input measures that drive's tendon; -1: its own
};

/// Which kind of drive each node of a daemon's file is. Reads the EDS files that it names.
class DriveProfiles {
 public:
  DriveProfiles() = default;
  explicit DriveProfiles(std::span<const NodeParameters> nodes);
  /// An EPOS4's for a node that is not in the file.
  canopen::DriveProfilePtr Of(int node_id) const;

 private:
  std::map<int, canopen::DriveProfilePtr> profiles_;
};

class VirtualRig {
 public:
  /// Drives answer as the node ids of the robot's actuation, in the order of their tendons, as EPOS4s unless
  /// `profiles` has their node; load cells are on each drive's first analog input, or the one of its profile.
  /// Throws std::invalid_argument when the robot has no actuation. `port` must outlive the rig. `more` drives
  /// follow those of the tendons; the caller simulates what is behind them.
  VirtualRig(const RobotParameters& robot, can::CanPort& port, const sim::PlantOptions& options = {},
             const DriveProfiles& profiles = {},
             std::span<const emulator::EmulatedDriveParameters> more = {});

  /// Moves the plant to `now_ns`, passes its sensors to the drives, lets them handle waiting frames and due
  /// actions, and passes their torque to the plant. The plant's time 0 is the first call; later calls must
  /// not go back in time. Returns the number of SYNCs handled. Throws std::runtime_error when the plant's
  /// integration gives up.
  ///
  /// A motor whose drive was never enabled is held by a brake, with the torque that holds the pretension.
  /// From its first enabling on the drive's torque acts, which is zero while it is disabled.
  int Poll(TimeNs now_ns);
  /// Brakes of motors that have not moved yet stay on even while their drives are enabled, until this is
  /// called with false: a robot armed like that starts exactly in the plant's initial state.
  void HoldBrakes(bool hold) { brakes_held_ = hold; }
  /// Changes the wiring of a drive (from 0); before the first Poll.
  void Connect(int drive, const Wiring& wiring) { wiring_[static_cast<std::size_t>(drive)] = wiring; }

  /// The tracker's reading once its period has passed since the last one taken; empty in between and for a
  /// robot without a tracker. Stamped now, on the clock of Poll; measured delay_s ago.
  std::optional<TrackerSample> TakeTrackerReading();

  const sim::Plant& plant() const { return plant_; }
  sim::Plant& plant() { return plant_; }
  emulator::DriveRack& drives() { return rack_; }

 private:
  void ShowSensors();
  void TurnEmptySpools(double seconds);

  RobotParameters robot_;
  sim::Plant plant_;
  emulator::DriveRack rack_;
  std::optional<TimeNs> start_ns_;
  TimeNs next_reading_ns_ = 0;  // of the tracker, in the plant's time
  std::vector<int> tendon_of_;  // by drive
  std::vector<bool> released_;  // by drive: it was enabled once
  bool brakes_held_ = false;
  Eigen::VectorXd torque_Nm_;   // present torque, by tendon
  std::vector<Wiring> wiring_;  // by drive
  struct EmptySpool {
    double angle_rad = 0, velocity_radps = 0, torque_Nm = 0;
  };
  std::vector<EmptySpool> empty_;  // of drives whose tendon is off
};

}  // namespace tendril::rig
