// Fixed capacities of everything that lives in the tick, so that no cycle ever allocates.
// Raising one costs memory only; the configuration refuses robots that do not fit.
#pragma once

#include <Eigen/Core>

namespace tendril {

inline constexpr int kMaxSections = 4;
inline constexpr int kMaxTendons = 16;  // over all sections
inline constexpr int kMaxUnits = 64;    // over all sections
inline constexpr int kMaxCoordinates = 6 * kMaxUnits;

/// What no command may ask for, far beyond any robot: whoever does means something else.
inline constexpr double kMostSpeed_radps = 1e3, kMostTip_m = 100, kMostTipSpeed_mps = 100;

/// One value a tendon, in tendon order 1..M over the sections; storage inside the object.
using TendonVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxTendons, 1>;
/// (us_1, vs_1, ..., us_K, vs_K) of the sections [rad].
using BendingVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * kMaxSections, 1>;
/// One value a pair of these, for example their covariance.
using BendingMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, 2 * kMaxSections>;
/// (u_1, v_1, ..., u_N, v_N) of units that only bend [rad].
using UnitVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * kMaxUnits, 1>;
/// One value a coordinate of any body.
using CoordinateVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxCoordinates, 1>;

}  // namespace tendril
