// Between base and motor side of the pulleys, for what one motor pulls: a tendon, or an antagonistic pair as
// one tendon that pulls both ways. Safe in the tick.
#pragma once

#include <memory>

#include "tendril/core/robot.h"
#include "tendril/model/capstan.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::model {

class PullMap {
 public:
  using Table = std::shared_ptr<const CapstanTable>;

  /// A tendon of its own: pulls are its tensions.
  PullMap(const TransmissionParameters& transmission, Table table);
  /// A pair: pulls are the first tendon's tension less the second's. The second slides the other way.
  PullMap(const TendonPairs::Pair& pair, const TransmissionParameters& first, Table first_table,
          const TransmissionParameters& second, Table second_table);

  bool is_pair() const noexcept { return second_.table != nullptr; }
  /// Tension of both tendons of a pair at the spool while the motor does not pull, from here on.
  void SetUnpulled(double tension_N) noexcept { unpulled_N_ = tension_N; }

  /// Pull at the base for one at the motor, and the reverse, at the first tendon's sliding state z in [-1,
  /// 1].
  double MotorToBase(double motor_N, double z) const noexcept;
  double BaseToMotor(double base_N, double z) const noexcept;
  /// What a pull at the base may take at the motor, whatever way the tendons slide.
  double LeastAtMotor(double base_N) const noexcept;
  double MostAtMotor(double base_N) const noexcept;

  /// The pull at the motor, or the nearest with which no tendon has more than `most_N`.
  double Within(double motor_N, double most_N) const noexcept;

  struct Tensions {
    double first_N, second_N;  // the latter of pairs
  };
  /// At the motor and at the base, for a pull at the motor.
  Tensions AtMotor(double motor_N) const noexcept;
  Tensions AtBase(double motor_N, double z) const noexcept;

 private:
  struct Side {
    Table table;
    double coulomb_N = 0;

    /// Base tension of a tendon, and the friction that may be between base and motor up to this tension.
    double Base_N(double motor_N, double z) const noexcept;
    double Friction_N(double most_N) const noexcept;
  };
  double PairFriction_N(double base_N) const noexcept;

  Side first_, second_;
  TendonPairs::Pair pair_{};  // of a pair
  double unpulled_N_ = 0;
};

}  // namespace tendril::model
