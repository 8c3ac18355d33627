// Gains of the load cells' feedback on the drives' torques, as they follow from the rig's numbers, and the
// margins they leave. For programs and constructors; knows nothing of the loop that runs with them.
#pragma once

#include <vector>

#include "tendril/core/robot.h"

namespace tendril::control {

struct TensionLoopMargins {
  double gain = 0;       // all feedback may grow by this factor before something oscillates
  double phase_deg = 0;  // smallest over the drives, each loop cut at its torque with the others closed
  bool stable = false;
};

/// u = travel (k_p e + k_i integral e) + k_v (w_wanted - w), e the tension error behind a low-pass and w the
/// motor's velocity from its encoder behind another.
struct TensionLoopGains {
  double bandwidth_radps = 0;  // of the closed loop of the softest way the body moves
  double proportional = 0;     // k_p, tension a tension
  double integral_ps = 0;      // k_i
  double cell_filter_s = 0, velocity_filter_s = 0;
  std::vector<double> damping_Nms;  // k_v, a tendon
  TensionLoopMargins margins;       // that DesignTensionLoop found for them
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

}  // namespace tendril::control
