// Motor torques for the commanded tensions: friction compensation or feed-forward with the load cells'
// feedback, limits, and rounding to what the bus carries. Knows nothing of how tensions are found.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "tendril/control/compensation.h"
#include "tendril/control/drive_feed_forward.h"
#include "tendril/control/take_up.h"
#include "tendril/control/tension_feedback.h"
#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::control {

class StateArchive;

class DriveTorques {
 public:
  using Tables = std::vector<std::shared_ptr<const model::CapstanTable>>;  // one per tendon

  /// `feeds_forward` as in LawRow; `gains` of the load cells' feedback, which needs it. Robot, parameters and
  /// tables outlive this object.
  DriveTorques(const RobotParameters& robot, const ControllerParameters& parameters, const Tables& tables,
               bool feeds_forward, const std::optional<TensionLoopGains>& gains, double period_s);

  struct Cycle {
    const CycleInput& input;
    Mode mode;
    bool controls_shape, zeroed;
    bool moving;         // the tendons move as their references say
    const TakeUp* bare;  // of motors whose tendons' state is unknown; else null
    const TendonVector& tension_N;
    const TendonVector& arc_shortening_m;  // of the reference arcs
  };
  /// Sets sliding_direction, tension_desired_motor_N and torque_desired_Nm.
  void Step(const Cycle& cycle, CycleOutput& output) noexcept;
  /// Sets torque_target_permille; zero unless `powered`.
  void Send(bool powered, CycleOutput& output) noexcept;

  /// No motion; directions start where the tendons are pulled to `shortening_m` without tension.
  void Reset(const TendonVector& shortening_m) noexcept;
  /// Largest tension that accelerated a rotor lately.
  double rotor_N() const noexcept { return rotor_N_; }
  /// Of pairs: what friction adds to both tensions at the base.
  const TendonVector& pair_offset_N() const noexcept { return pair_offset_N_; }
  /// Reference displacement of the last cycle.
  const TendonVector& last_reference_m() const noexcept { return last_reference_m_; }

  void Archive(StateArchive& archive) noexcept;

 private:
  Pulled PulledBy(int tendon) const;
  void JoinPair(const model::TendonPairs::Pair& pair, const CycleOutput& output) noexcept;
  void PartPair(const model::TendonPairs::Pair& pair, bool bare, CycleOutput& output) noexcept;
  Compensation::Result Torque(int tendon, const Cycle& cycle, const CycleOutput& output) noexcept;
  Compensation::Result FeedForward(int tendon, const Cycle& cycle, const CycleOutput& output) noexcept;
  double FrictionUncertainty_N(int tendon, double tension_N, double sliding) const noexcept;
  double FeedbackTorque(int tendon, const Cycle& cycle, double measured_N,
                        const DriveFeedForward::Result& commanded) noexcept;
  double LimitTorque(int tendon, double fed_back_Nm, double measured_N,
                     const DriveFeedForward::Result& commanded, Status& status) noexcept;
  bool LostTendon(int tendon, const Cycle& cycle, const CycleOutput& output) noexcept;
  bool Rests(const CycleOutput& output, const TendonVector& tension_N) noexcept;
  std::int16_t Round(int tendon, double permille) const noexcept;

  const RobotParameters& robot_;
  const ControllerParameters& parameters_;
  const Tables& tables_;
  int tendons_;
  double period_s_;
  std::vector<Compensation> compensation_;
  std::vector<DriveFeedForward> feed_forward_;  // empty: friction compensation only
  std::vector<TensionFeedback> feedback_;       // empty: off

  model::TendonPairs pairs_;
  // Of this cycle, by tendon; a pair's as what its motor pulls, at its first tendon.
  TendonVector pull_N_, path_m_, arc_m_, unpulled_N_;
  TendonVector pair_offset_N_;
  bool rests_ = false;                                // references are at rest in this cycle
  double most_rotor_N_ = 0;                           // in this cycle
  double rotor_N_ = 0;                                // lately
  TendonVector last_reference_N_, last_reference_m_;  // of the last cycle
  TendonVector last_displacement_m_;                  // measured in the last cycle
  std::array<bool, kMaxTendons> lost_{};              // tendons without tension, after a fault
  std::array<double, kMaxTendons> last_fed_back_Nm_{}, fed_back_at_N_{};  // last, and the tension then
  std::array<double, kMaxTendons> permille_left_over_{};  // rounding remainder of the torque sent
  std::array<std::int16_t, kMaxTendons> sent_permille_{};
};

}  // namespace tendril::control
