// Motors without a robot: what turns behind the drives that a plant has beyond those of its robot file, so
// that a bus can be filled. Knows rotors and friction; nothing of frames.
#pragma once

#include <string>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::tools {

/// Node ids of a list such as "4-127" or "4-8,40". Throws std::invalid_argument with one line naming what
/// does not fit: not understood, out of 1..127, given twice, or one of `taken`.
std::vector<int> ParseNodeList(const std::string& text, const std::vector<int>& taken);

/// Drives for these nodes with the motor's data.
std::vector<emulator::EmulatedDriveParameters> FreeDrives(const std::vector<int>& nodes,
                                                          const TendonDriveParameters& like);

/// J dw/dt = tau - coulomb sign(w) - viscous w, with standstill up to the Coulomb friction.
class FreeMotors {
 public:
  /// Of the rack's drives from `first` on; `rack` must outlive the motors.
  FreeMotors(emulator::DriveRack& rack, int first, const TendonDriveParameters& like);

  /// Moves the motors on to `now_ns` under the torques in force since the last call and shows them to their
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

}  // namespace tendril::tools
