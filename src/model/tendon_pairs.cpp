#include "tendril/model/tendon_pairs.h"

#include <algorithm>

namespace tendril::model {

TendonPairs::TendonPairs(const RobotParameters& robot) {
  if (!robot.actuation) return;
  least_N_ = robot.limits.min_tension_N;
  const auto stiffness_Npm = [&](int tendon) {
    return robot.actuation->tendons[static_cast<std::size_t>(tendon)].tendon.stiffness_Npm;
  };
  for (const TendonPair& pair : robot.actuation->pairs) {
    const double a = stiffness_Npm(pair.first), b = stiffness_Npm(pair.second);
    pairs_.push_back({pair.first, pair.second, pair.pretension_N, a * b / (a + b), a / (a + b)});
  }
}

bool TendonPairs::Share(const TendonVector& shortening_m, double most_N,
                        TendonVector& tension_N) const noexcept {
  bool limited = false;
  for (const Pair& pair : pairs_) {
    const double asked_N = tension_N[pair.first] - tension_N[pair.second];
    const double unpulled_N = Unpulled_N(pair, shortening_m), a = pair.first_share, b = 1 - a;
    const double give_N = std::max(0.0, unpulled_N - least_N_), room_N = std::max(0.0, most_N - unpulled_N);
    const double pull_N =
        std::clamp(asked_N, -std::min(give_N / a, room_N / b), std::min(give_N / b, room_N / a));
    limited = limited || pull_N != asked_N;
    tension_N[pair.first] = unpulled_N + a * pull_N;
    tension_N[pair.second] = unpulled_N - b * pull_N;
  }
  return limited;
}

TendonVector RestTensions_N(const RobotParameters& robot) {
  TendonVector rest_N(robot.body.tendons());
  for (int j = 0; j < rest_N.size(); ++j) rest_N[j] = robot.RestTension_N(j);
  return rest_N;
}

}  // namespace tendril::model
