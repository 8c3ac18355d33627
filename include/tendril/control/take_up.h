// Bare motors, before the tendons' state is known: gentle pulls at bounded speed and travel, and the homing
// that takes up slack with them. Knows nothing of modes or the robot's shape.
#pragma once

#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"

namespace tendril::control {

class StateArchive;

class TakeUp {
 public:
  TakeUp(const RobotParameters& robot, const TakeUpParameters& parameters, double ramp_Nps, double settle_s,
         TimeNs period_ns);

  /// Starts counting travel; all tendons count as slack until found taut.
  void Start(const CycleInput& input) noexcept;

  /// Once per cycle from Start on, unless Home is called: updates speed and travel. kTravelOverLimit when a
  /// tendon moved too far in either direction.
  Status Watch(const CycleInput& input) noexcept;

  /// Motor torque [N m] of a bare pull [N, +-]: pull x travel per angle, without losses, limited to pull_N
  /// and reduced as the tendon's speed approaches max_speed_mps. The speed bound holds whatever the signs of
  /// motor and encoder.
  double Torque(int tendon, double pull_N) const noexcept;

  /// The pulls of the next cycle, towards `target_N`: increased at the ramp's rate, reduced at once.
  void Ramp(const TendonVector& target_N, TendonVector& pull_N) const noexcept;

  /// One cycle of homing: each pull rises until its load cell measures the pretension (without a cell: until
  /// the motor stands), then holds it; a motor that pulls a pair is left alone. A fault names what prevents
  /// that.
  Status Home(const CycleInput& input, const CycleOutput& output, TendonVector& pull_N) noexcept;
  /// All tendons have been taut at pretension for settle_s.
  bool homed() const noexcept { return settled_for_ >= settle_cycles_; }
  /// Tendon of the last fault, from 1.
  int tendon() const noexcept { return blamed_; }

  void Archive(StateArchive& archive) noexcept;

 private:
  struct Tendon {
    double travel_m, travel_per_count_m;  // per motor angle, per count
    double friction_N, efficiency;
    bool cell;
    bool in_pair;  // pretensioned by assembly: there is no slack to take up
    std::int32_t start_counts = 0, counts = 0;
    double speed_mps = 0;  // low-passed
    std::int32_t standing_for = 0, standing_counts = 0;
    std::int32_t same_for = 0;
    std::int16_t cell_mV = 0;
    bool taut = false;
    double TravelM() const noexcept;
  };

  Status Judge(Tendon& tendon, const DriveFeedback& drive, double shown_N, double pull_N) noexcept;

  TakeUpParameters parameters_;
  double pretension_N_, step_N_, period_s_;
  std::int32_t settle_cycles_, timeout_cycles_;
  std::vector<Tendon> tendons_;
  std::int32_t homing_for_ = 0, settled_for_ = 0, blamed_ = 0;
};

}  // namespace tendril::control
