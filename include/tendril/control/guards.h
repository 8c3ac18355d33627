// The guards on what drives and sensors report: each a rule with a threshold of the configuration, broken or
// not, with the same few cycles of confirmation. Knows nothing of modes or of what a fault leads to.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"

namespace tendril::control {

class StateArchive;

/// What may be expected of the robot in a cycle.
struct Expectation {
  bool powered = false;    // drives hold the tendons: motion is judged
  bool trusted = true;     // load cells are known to work: they are judged by more than the limit of tension
  bool tensioned = false;  // pretension is reached and displacement zeroed: slack and shape are judged
  bool follows = false;    // the robot follows the reference of shape: so is the following error
};

class Guards {
 public:
  /// `body` and `tables` (one a tendon) outlive the guards.
  Guards(const RobotParameters& robot, const GuardParameters& parameters, TimeNs period_ns,
         const model::Body& body, const std::vector<std::shared_ptr<const model::CapstanTable>>& tables);

  /// The first rule broken by this cycle's input and the estimates in `output`, kOk when all are kept.
  Status Check(const CycleInput& input, const CycleOutput& output, const Expectation& expected) noexcept;

  /// Whose rule Check found broken, from 1; 0: that of no single tendon.
  int tendon() const noexcept { return blamed_; }
  /// More cycles than guards.max_late_cycles were skipped at once or within about a second, and it is no
  /// second ago; whether or not motors pull.
  bool behind() const noexcept { return behind_; }

  /// End of the cycle: what the next ones are expected to show. `reference_m` is the displacement of the shape
  /// that is wanted, which a correction of the goal by a tracker is no part of.
  void Expect(const CycleOutput& output, const TendonVector& reference_m) noexcept;
  /// Forgets what was seen: the drives were handled by others, or displacement was zeroed.
  void Restart() noexcept;

  void Remember(StateArchive& archive) noexcept;

 private:
  // What is counted as broken for how many cycles in a row.
  enum Rule {
    kSlack,
    kDisconnected,
    kDisagrees,
    kOverSpeed,
    kTorque,
    kFollowing,
    kBending,
    kEstimate,
    kRules
  };

  struct Tendon {
    // Of the robot.
    double travel_m, travel_per_count_m, stiffness_Npm, efficiency, coulomb_Nm, torque_scale, inertia_kg,
        rated_Nm;
    LoadCellPlace place;
    // From cycle to cycle.
    std::array<std::int32_t, kRules> broken_for{};
    bool seen = false;
    std::int32_t counts = 0;                      // of the last fresh feedback
    std::int32_t unheard = 0;                     // cycles since
    double speed_mps = 0, acceleration_mps2 = 0;  // low-passed
    std::int16_t cell_mV = 0;                     // since when the cell has shown the same:
    std::int32_t same_for = 0;
    double least_torque_N = 0, most_torque_N = 0;
    // Torque asked for [per mille], the last first: it is on the motor in the cycle after the next SYNC.
    std::array<std::int16_t, 3> asked{};
    DriveFeedback shown{};// since when all of the feedback has been the same:
    std::int32_t frozen_for = 0;
    std::int16_t asked_since = 0;  // what was asked for then
  };

  Status CheckTime(const CycleInput& input, bool powered) noexcept;
  Status CheckMotion(Tendon& tendon, const DriveFeedback& drive, bool powered) noexcept;
  Status CheckTorque(Tendon& tendon, const DriveFeedback& drive, bool powered) noexcept;
  Status CheckCell(std::size_t j, const DriveFeedback& drive, const CycleOutput& output,
                   bool powered) noexcept;
  Status CheckShape(const CycleOutput& output, const Expectation& expected) noexcept;
  double MotorTension(std::size_t j, const CycleOutput& output) const noexcept;
  bool OverTension(std::size_t j, double reading_N) const noexcept;
  /// Counts; true once broken for as long as it must be.
  bool Confirmed(Tendon& tendon, Rule rule, bool broken, std::int32_t cycles) const noexcept;

  GuardParameters parameters_;
  const model::Body& body_;
  const std::vector<std::shared_ptr<const model::CapstanTable>>& tables_;
  TimeNs period_ns_;
  double max_tension_N_, max_base_N_, min_tension_N_, max_bending_rad_;
  std::int32_t slack_cycles_;
  std::vector<Tendon> tendons_;
  UnitVector q_;  // of this cycle only
  TendonVector desired_m_;
  bool timed_ = false;
  TimeNs last_time_ns_ = 0;
  double late_ = 0;  // cycles; empties in a second
  bool behind_ = false;
  std::int32_t blamed_ = 0;
};

}  // namespace tendril::control
