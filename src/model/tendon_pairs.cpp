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

TendonPairs::Pair::Range TendonPairs::Pair::PullsWithin(double unpulled_N, double least_N,
                                                        double most_first_N,
                                                        double most_second_N) const noexcept {
  const double a = first_share, b = 1 - first_share;
  const double give_N = std::max(0.0, unpulled_N - least_N);
  const double first_N = std::max(0.0, most_first_N - unpulled_N);
  const double second_N = std::max(0.0, most_second_N - unpulled_N);
  return {-std::min(give_N / a, second_N / b), std::min(give_N / b, first_N / a)};
}

void TendonPairs::Pair::Split(double unpulled_N, double pull_N, TendonVector& tension_N) const noexcept {
  tension_N[first] = unpulled_N + first_share * pull_N;
  tension_N[second] = unpulled_N - (1 - first_share) * pull_N;
}

bool TendonPairs::Share(const TendonVector& shortening_m, double most_N,
                        TendonVector& tension_N) const noexcept {
  bool limited = false;
  for (const Pair& pair : pairs_) {
    const double asked_N = tension_N[pair.first] - tension_N[pair.second];
    const double unpulled_N = Unpulled_N(pair, shortening_m);
    const Pair::Range range = pair.PullsWithin(unpulled_N, least_N_, most_N, most_N);
    const double pull_N = std::clamp(asked_N, range.least_N, range.most_N);
    limited = limited || pull_N != asked_N;
    pair.Split(unpulled_N, pull_N, tension_N);
  }
  return limited;
}

TendonVector RestTensions_N(const RobotParameters& robot) {
  TendonVector rest_N(robot.body.tendons());
  for (int j = 0; j < rest_N.size(); ++j) rest_N[j] = robot.RestTension_N(j);
  return rest_N;
}

}  // namespace tendril::model
