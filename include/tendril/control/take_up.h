// Handling tendons before anything is known of them: bare motors that pull gently, at a bounded speed and
// over a bounded travel, and the homing that winds slack in with them. Knows nothing of modes or the robot's
// shape.
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

  /// Travel counts from here, and every tendon has to be found taut again.
  void Start(const CycleInput& input) noexcept;

  /// Once a cycle from Start on, unless Home is called: speed and travel. kTravelOverLimit when a tendon went
  /// too far either way.
  Status Watch(const CycleInput& input) noexcept;

  /// Motor torque [N m] of a bare pull [N, +-]: pull x travel per angle, without losses, at most pull_N, less
  /// the nearer the tendon's speed comes to max_speed_mps. That holds whichever way motor and encoder are
  /// connected.
  double Torque(int tendon, double pull_N) const noexcept;

  /// The pulls of the next cycle, towards `wanted_N`: more of them at the ramp's rate, less at once.
  void Lead(const TendonVector& wanted_N, TendonVector& pull_N) const noexcept;

  /// One cycle of homing: every pull rises until its load cell shows the pretension (without a cell:
  /// until the motor stands), then follows it. A fault says what keeps a tendon from it.
  Status Home(const CycleInput& input, const CycleOutput& output, TendonVector& pull_N) noexcept;
  /// Every tendon has been taut at pretension for settle_s.
  bool homed() const noexcept { return settled_for_ >= settle_cycles_; }
  /// Of the last fault, from 1.
  int tendon() const noexcept { return blamed_; }

  void Remember(StateArchive& archive) noexcept;

 private:
  struct Tendon {
    double travel_m, travel_per_count_m;  // per motor angle, per count
    double friction_N, efficiency;
    bool cell;
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
