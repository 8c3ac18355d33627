#include "tendril/model/pull_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

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
      share_(pair.first_share),
      unpulled_N_(pair.pretension_N) {}

double PullMap::Side::Base_N(double motor_N, double z) const noexcept {
  return std::max(0.0, table->MotorToBase(std::max(0.0, motor_N), z) - coulomb_N * z);
}

double PullMap::Side::Friction_N(double most_N) const noexcept {
  return table->Pull(most_N + coulomb_N) - table->Release(std::max(0.0, most_N - coulomb_N));
}

double PullMap::Within(double motor_N, double most_N) const noexcept {
  if (!is_pair()) return std::min(motor_N, most_N);
  const double room_N = std::max(0.0, most_N - unpulled_N_);
  return std::clamp(motor_N, -room_N / (1 - share_), room_N / share_);
}

PullMap::Tensions PullMap::AtMotor(double motor_N) const noexcept {
  if (!is_pair()) return {motor_N, 0};
  return {unpulled_N_ + share_ * motor_N, unpulled_N_ - (1 - share_) * motor_N};
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

// Of a pair by bracketed secant steps: the map rises with the pull.
double PullMap::BaseToMotor(double base_N, double z) const noexcept {
  if (!is_pair()) return first_.table->BaseToMotor(std::max(0.0, base_N + first_.coulomb_N * z), z);
  const double friction_N = PairFriction_N(base_N);
  double low_N = base_N - friction_N, high_N = base_N + friction_N;
  double at_low = MotorToBase(low_N, z) - base_N, at_high = MotorToBase(high_N, z) - base_N;
  if (at_low >= 0) return low_N;
  if (at_high <= 0) return high_N;
  double motor_N = base_N;
  int side = 0;
  for (int i = 0; i < kMostSteps && high_N - low_N > kSolved_N; ++i) {
    motor_N = (low_N * at_high - high_N * at_low) / (at_high - at_low);
    const double at = MotorToBase(motor_N, z) - base_N;
    if (std::abs(at) <= kSolved_N) break;
    // Illinois: halve the weight of an end that stays, so that both ends converge.
    if (at > 0) {
      high_N = motor_N;
      at_high = at;
      if (side == 1) at_low *= 0.5;
      side = 1;
    } else {
      low_N = motor_N;
      at_low = at;
      if (side == -1) at_high *= 0.5;
      side = -1;
    }
  }
  return motor_N;
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
