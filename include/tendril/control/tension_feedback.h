// Feedback from a load cell to its drive's torque: the loop of one tendon. Knows nothing of where reference
// tensions come from.
#pragma once

#include <array>

#include "tendril/control/tension_loop_design.h"
#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

/// One tendon's loop.
class TensionFeedback {
 public:
  TensionFeedback(const TendonDriveParameters& drive, const LimitParameters& limits,
                  const TensionLoopGains& gains, int tendon, double period_s);

  struct Reference {
    double cell_N = 0;  // at the load cell
    double motor_velocity_radps = 0;
    double uncertainty_N = 0;  // uncertainty of cell_N: smaller errors are ignored
    bool rests = false;        // the reference is at rest
  };

  /// Torque to add [N·m]. `reference` belongs to the torque now sent and is compared with the cell two cycles
  /// later, when the torque shows. At rest, with the error within the hold of dry friction and the motor
  /// standing, the torque is held. `acts` false: no feedback, and the integral is reset.
  double Step(const DriveFeedback& feedback, double measured_N, const Reference& reference,
              bool acts) noexcept;
  /// Reports saturation of the torque: by `excess` (> 0 too much). The integral is held until the error
  /// changes sign.
  void Limited(double excess_Nm) noexcept { limited_ = excess_Nm; }

  void Reset() noexcept;
  void Archive(StateArchive& archive) noexcept;

 private:
  static constexpr int kDelayCycles = 2;

  double period_s_, proportional_, integral_ps_, cell_share_, velocity_share_, damping_Nms_;
  double travel_m_, rad_per_count_, rest_band_N_, most_N_, torque_scale_;
  std::array<Reference, kDelayCycles> reference_{};
  double error_N_ = 0, integral_N_ = 0, velocity_error_radps_ = 0, limited_ = 0;
  std::int32_t counts_ = 0, stood_at_counts_ = 0, stood_cycles_ = 0;
  double held_Nm_ = 0;  // last output
  bool running_ = false;
};

}  // namespace tendril::control
