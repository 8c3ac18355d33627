// Feedback of the load cells on the drives' torques: gains that follow from the rig's numbers, the margins
// they leave, and the loop of one tendon. Knows nothing of where wanted tensions come from.
#pragma once

#include <array>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

/// u = travel (k_p e + k_i integral e) + k_v (w_wanted - w), e the tension error behind a low-pass and w the
/// motor's velocity from its encoder behind another.
struct TensionLoopGains {
  double bandwidth_radps = 0;  // of the closed loop of the softest way the body moves
  double proportional = 0;     // k_p, tension a tension
  double integral_ps = 0;      // k_i
  double cell_filter_s = 0, velocity_filter_s = 0;
  std::vector<double> damping_Nms;  // k_v, a tendon
};

struct TensionLoopMargins {
  double gain = 0;       // all feedback may grow by this factor before something oscillates
  double phase_deg = 0;  // smallest over the drives, each loop cut at its torque with the others closed
  bool stable = false;
};

/// What every design has to leave: the gear alone changes the loop's gain by its efficiency and the inverse.
inline constexpr double kLeastGainMargin = 2;
inline constexpr double kLeastPhaseMargin_deg = 45;
/// As far as all feedback may still grow where tendons are half or twice as stiff as their file says.
inline constexpr double kLeastDoubtedMargin = 1.25;
/// Gain margins are not told apart beyond this.
inline constexpr double kMostGainMargin = 20;

/// Margins on the rig linearised about the straight robot, one bent half as far as it may be and one bent all
/// the way, the least of them; stable only when tendons half and twice as stiff leave it so too. Rotors,
/// tendons as springs and dampers, every unit's bending, torque loops, the cycle that a command waits and the
/// one it is held. Dry friction, which only damps, is left out. For programs and constructors, not for the
/// tick.
TensionLoopMargins CheckTensionLoop(const RobotParameters& robot, const TensionLoopGains& gains,
                                    double period_s);

/// The fastest of one family of designs that leaves both margins: critically damped enough (0.7) at the
/// bandwidth, integral action a quarter of it. Bandwidth 0 when none does.
TensionLoopGains DesignTensionLoop(const RobotParameters& robot, double period_s);

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
  double begun_ = 0;    // share that acts
  bool running_ = false;
};

}  // namespace tendril::control
