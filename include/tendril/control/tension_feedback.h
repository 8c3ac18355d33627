// Feedback of a load cell on its drive's torque: the loop of one tendon. Knows nothing of where wanted
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

  struct Wanted {
    double cell_N = 0;  // at the load cell
    double motor_velocity_radps = 0;
    double unsure_N = 0;  // of cell_N: an error up to this says nothing
    bool rests = false;   // nothing is led anywhere
  };

  /// Torque to add [N·m]. `wanted` is what the torque now sent is meant for; it is compared with the cell two
  /// cycles later, when it shows. At rest, with the error within what dry friction holds and a motor that
  /// stands, the torque stands as well. `acts` false: not fed back, the integral rests at zero.
  double Step(const DriveFeedback& feedback, double measured_N, const Wanted& wanted, bool acts) noexcept;
  /// What became of the torque: at a limit in the direction of `excess` (> 0 too much) the integral stands
  /// still until the error turns.
  void Limited(double excess_Nm) noexcept { limited_ = excess_Nm; }

  void Reset() noexcept;
  void Remember(StateArchive& archive) noexcept;

 private:
  static constexpr int kDelayCycles = 2;

  double period_s_, proportional_, integral_ps_, cell_share_, velocity_share_, damping_Nms_;
  double travel_m_, rad_per_count_, rest_band_N_, most_N_, torque_scale_;
  std::array<Wanted, kDelayCycles> wanted_{};
  double error_N_ = 0, integral_N_ = 0, velocity_error_radps_ = 0, limited_ = 0;
  std::int32_t counts_ = 0, stood_at_counts_ = 0, stood_cycles_ = 0;
  double held_Nm_ = 0;  // put out last
  bool running_ = false;
};

}  // namespace tendril::control
