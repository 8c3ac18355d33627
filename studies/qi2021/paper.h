// What the paper prints: Qi et al., Dynamic of Cable-driven Continuum Robot with Nonlinear Friction Model,
// 2021. Knows nothing of what comes out here.
#pragma once

#include <numbers>

namespace tendril::qi2021 {

inline constexpr double kPi = std::numbers::pi;

// Section 3.
inline constexpr double kZeroTensionStart_rad = 1e-4;                                        // 3.1
inline constexpr double kPull_N = 5, kPullStart_rad = kPi / 12, kPullStartBeta_rad = 0.001;  // 3.2
inline constexpr double kPaperEquilibrium_rad = kPi / 6;                                     // Fig. 5b

// Section 5. The wire: 0.8 mm in diameter there, a radius of 0.5 mm in table 1.
inline constexpr double kWireRadius_m = 0.0004, kTextLength_m = 0.090;
inline constexpr double kPlanarBend_rad = 1.6, kPlanarLoss_N = 1.26, kPlanarRate_radps = 0.26;    // 5.1
inline constexpr double kCircleBend_rad = kPi / 3, kCircleLoss_N = 0.42, kTextRate_radps = 0.53;  // 5.2
inline constexpr double kCircleRadius_m = 28.6479e-3, kCircleHeight_m = 49.6196e-3,
                        kCircleRate_radps = kPi / 6;  // eq. 31

// "Negligible" is not defined by the paper; a twentieth of what is needed is generous.
inline constexpr double kNegligible = 0.05;

}  // namespace tendril::qi2021
