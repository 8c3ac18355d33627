// Motors without a robot: the load of the plant's drives beyond those of its robot file, with which a bus can
// be filled. Knows rotors and friction; nothing of frames.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::rig {

/// Node ids of a list such as "4-127" or "4-8,40". Throws std::invalid_argument with one line naming the
/// error: not understood, out of 1..127, given twice, or one of `taken`.
std::vector<int> ParseNodeList(const std::string& text, const std::vector<int>& taken);

/// Drives for these nodes with the motor's data.
std::vector<emulator::EmulatedDriveParameters> FreeDrives(const std::vector<int>& nodes,
                                                          const TendonDriveParameters& like);

/// J dw/dt = tau - coulomb sign(w) - viscous w, with standstill up to the Coulomb friction.
class FreeMotors {
 public:
  /// Motors of the rack's drives from `first` on; `rack` must outlive them.
  FreeMotors(emulator::DriveRack& rack, int first, const TendonDriveParameters& like);

  /// Moves the motors to `now_ns` under the torques active since the last call and passes them to their
  /// drives. Call before the drives' Poll.
  void Poll(TimeNs now_ns);

 private:
  struct Motor {
    double velocity_radps = 0, counts = 0;
  };

  emulator::DriveRack& rack_;
  int first_;
  MotorParameters parameters_;
  double counts_per_rad_;
  std::vector<Motor> motors_;
  TimeNs now_ns_ = -1;
};

}  // namespace tendril::rig
