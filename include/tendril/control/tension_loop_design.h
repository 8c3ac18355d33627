// Gains of the load cells' feedback on the drives' torques, designed from the rig's parameters, and their
// stability margins. For programs and constructors; knows nothing of the loop that uses them.
#pragma once

#include <vector>

#include "tendril/core/robot.h"

namespace tendril::control {

struct TensionLoopMargins {
  double gain = 0;       // all feedback gains may grow by this factor before instability
  double phase_deg = 0;  // smallest over the drives, each loop cut at its torque with the others closed
  bool stable = false;
};

/// u = travel (k_p e + k_i integral e) + k_v (w_ref - w), with e the low-passed tension error and w the
/// low-passed motor velocity from the encoder.
struct TensionLoopGains {
  double bandwidth_radps = 0;  // of the closed loop of the body's softest mode
  double proportional = 0;     // k_p, tension per tension
  double integral_ps = 0;      // k_i
  double cell_filter_s = 0, velocity_filter_s = 0;
  std::vector<double> damping_Nms;  // k_v, per tendon
  TensionLoopMargins margins;       // as found by DesignTensionLoop
};

/// Margins required of every design: the gear alone changes the loop gain by its efficiency or the inverse.
inline constexpr double kLeastGainMargin = 2;
inline constexpr double kLeastPhaseMargin_deg = 45;
/// Gain margin required when tendons are half or twice as stiff as the robot file states.
inline constexpr double kLeastPerturbedMargin = 1.25;
/// Gain margins are not resolved beyond this.
inline constexpr double kMostGainMargin = 20;

/// The least margins of the rig linearised at zero, half and full bend; stable only if also with tendons half
/// and twice as stiff. Models rotors, tendons as springs and dampers, every unit's bending, torque loops, and
/// the cycle of delay and of hold of a command. Dry friction, which only damps, is omitted. For programs and
/// constructors, not for the tick.
TensionLoopMargins CheckTensionLoop(const RobotParameters& robot, const TensionLoopGains& gains,
                                    double period_s);

/// The fastest of one family of designs with both margins: damping ratio 0.7 at the bandwidth, integral
/// action at a quarter of it. Bandwidth 0 when there is none.
TensionLoopGains DesignTensionLoop(const RobotParameters& robot, double period_s);

}  // namespace tendril::control
