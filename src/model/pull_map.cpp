#include "tendril/model/pull_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/model/bracketed_root.h"

namespace tendril::model {
namespace {

constexpr int kMostSteps = 40;
constexpr double kSolved_N = 1e-9;

}  // namespace

PullMap::PullMap(const TransmissionParameters& transmission, Table table)
    : first_{std::move(table), transmission.coulomb_N} {}

PullMap::PullMap(const TendonPairs::Pair& pair, const TransmissionParameters& first, Table first_table,
                 const TransmissionParameters& second, Table second_table)
    : first_{std::move(first_table), first.coulomb_N},
      second_{std::move(second_table), second.coulomb_N},
      pair_(pair),
      unpulled_N_(pair.pretension_N) {}

double PullMap::Side::Base_N(double motor_N, double z) const noexcept {
  return std::max(0.0, table->MotorToBase(std::max(0.0, motor_N), z) - coulomb_N * z);
}

double PullMap::Side::Friction_N(double most_N) const noexcept {
  return table->Pull(most_N + coulomb_N) - table->Release(std::max(0.0, most_N - coulomb_N));
}

double PullMap::Within(double motor_N, double most_N) const noexcept {
  if (!is_pair()) return std::min(motor_N, most_N);
  const auto pulls = pair_.PullsWithin(unpulled_N_, -HUGE_VAL, most_N, most_N);
  return std::clamp(motor_N, pulls.least_N, pulls.most_N);
}

PullMap::Tensions PullMap::AtMotor(double motor_N) const noexcept {
  if (!is_pair()) return {motor_N, 0};
  return {unpulled_N_ + pair_.first_share * motor_N, unpulled_N_ - (1 - pair_.first_share) * motor_N};
}

PullMap::Tensions PullMap::AtBase(double motor_N, double z) const noexcept {
  if (!is_pair()) return {MotorToBase(motor_N, z), 0};
  const Tensions at_motor = AtMotor(motor_N);
  return {first_.Base_N(at_motor.first_N, z), second_.Base_N(at_motor.second_N, -z)};
}

double PullMap::MotorToBase(double motor_N, double z) const noexcept {
  if (!is_pair()) return first_.table->MotorToBase(motor_N, z) - first_.coulomb_N * z;
  const Tensions base = AtBase(motor_N, z);
  return base.first_N - base.second_N;
}

// Of a pair: the map rises with the pull.
double PullMap::BaseToMotor(double base_N, double z) const noexcept {
  if (!is_pair()) return first_.table->BaseToMotor(std::max(0.0, base_N + first_.coulomb_N * z), z);
  const double friction_N = PairFriction_N(base_N);
  const double low_N = base_N - friction_N, high_N = base_N + friction_N;
  const auto excess_N = [this, base_N, z](double motor_N) { return MotorToBase(motor_N, z) - base_N; };
  const double at_low = excess_N(low_N), at_high = excess_N(high_N);
  if (at_low >= 0) return low_N;
  if (at_high <= 0) return high_N;
  return BracketedRoot(excess_N, low_N, at_low, high_N, at_high, kSolved_N, kMostSteps);
}

// No tendon of the pair has more than the unpulled tension and the whole pull.
double PullMap::PairFriction_N(double base_N) const noexcept {
  const double most_N = std::max(0.0, unpulled_N_) + std::abs(base_N);
  return first_.Friction_N(most_N) + second_.Friction_N(most_N);
}

double PullMap::LeastAtMotor(double base_N) const noexcept {
  if (is_pair()) return BaseToMotor(base_N, -1);
  return first_.table->Release(std::max(0.0, base_N - first_.coulomb_N));
}

double PullMap::MostAtMotor(double base_N) const noexcept {
  if (is_pair()) return BaseToMotor(base_N, 1);
  return first_.table->Pull(base_N + first_.coulomb_N);
}

}  // namespace tendril::model
