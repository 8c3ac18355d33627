// Whether a tip in metres was meant in millimetres. Asked wherever a person or program gives a tip.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdio>
#include <string>

namespace tendril {

/// Of no robot in particular: longer than any of this kind.
inline constexpr double kLongestRobot_m = 10;

/// "; millimetres? That would be 0 0 0.06 m" for a tip [m, base frame] that, taken in millimetres, lies from
/// a tenth of the robot's length to twice it from the base; where no robot is known, for one from
/// kLongestRobot_m on. Else empty. `length_m`: the robot's; 0: not known.
inline std::string AskMillimetres(const Eigen::Vector3d& tip_W_m, double length_m = 0) {
  constexpr double kPerMetre = 1e3;
  const bool known = length_m > 0;
  const double least_m = known ? 0.1 * kPerMetre * length_m : kLongestRobot_m;
  const double most_m = 2 * kPerMetre * (known ? length_m : kLongestRobot_m);
  const double distance_m = tip_W_m.norm();
  if (!(distance_m > least_m && distance_m < most_m)) return {};
  const Eigen::Vector3d meant_m = tip_W_m / kPerMetre;
  std::array<char, 128> text{};
  std::snprintf(text.data(), text.size(), "; millimetres? That would be %.4g %.4g %.4g m", meant_m.x(),
                meant_m.y(), meant_m.z());
  return text.data();
}

}  // namespace tendril
