// Guards on the feedback of drives and sensors: each is a rule with a configured threshold, confirmed over a
// few cycles. Knows nothing of modes or of the consequence of a fault.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::control {

class StateArchive;

/// What the guards may expect of the robot in this cycle.
struct Expectation {
  bool powered = false;    // drives are powered: motion is checked
  bool trusted = true;     // load cells are known to work: checked beyond the tension limit
  bool tensioned = false;  // at pretension, displacement zeroed: slack and shape are checked
  bool follows = false;    // the shape reference is followed: following error is checked
};

class Guards {
 public:
  /// `body` and `tables` (one a tendon) outlive the guards.
  Guards(const RobotParameters& robot, const GuardParameters& parameters, TimeNs period_ns,
         const model::Body& body, const std::vector<std::shared_ptr<const model::CapstanTable>>& tables);

  /// The first rule that this cycle's input or the estimates in `output` break; kOk when none is broken.
  Status Check(const CycleInput& input, const CycleOutput& output, const Expectation& expected) noexcept;

  /// Tendon of the broken rule, from 1; 0 when the rule concerns no single tendon.
  int tendon() const noexcept { return blamed_; }
  /// Within about the last second more than guards.max_late_cycles cycles were skipped, powered or not.
  bool behind() const noexcept { return behind_; }

  /// End of the cycle: stores what the next cycles are compared with. `reference_m` is the displacement of
  /// the reference shape, without the tracker's correction of the goal.
  void Expect(const CycleOutput& output, const TendonVector& reference_m) noexcept;
  /// Clears the history, after others handled the drives or displacement was zeroed.
  void Restart() noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  // Rules with a counter of consecutive broken cycles.
  enum Rule {
    kOverTension,
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
    // Parameters.
    double travel_m, travel_per_count_m, stiffness_Npm, efficiency, coulomb_Nm, torque_scale, inertia_kg,
        rated_Nm;
    LoadCellPlace place;
    bool in_pair;  // its own tension is not known: there is no slack to see
    // State.
    std::array<std::int32_t, kRules> broken_for{};
    bool seen = false;
    std::int32_t counts = 0;                      // of the last fresh feedback
    std::int32_t unheard = 0;                     // cycles since then
    double speed_mps = 0, acceleration_mps2 = 0;  // low-passed
    std::int16_t cell_mV = 0;                     // last cell reading
    std::int32_t same_for = 0;                    // cycles with this reading
    double least_torque_N = 0, most_torque_N = 0;
    // Commanded torque [per mille], latest first; it acts in the cycle after the next SYNC.
    std::array<std::int16_t, 3> asked{};
    DriveFeedback shown{};         // last feedback that differed
    std::int32_t frozen_for = 0;   // cycles with this feedback
    std::int16_t asked_since = 0;  // torque commanded when the feedback froze
  };

  Status CheckTime(const CycleInput& input, bool powered) noexcept;
  Status CheckMotion(Tendon& tendon, const DriveFeedback& drive, bool powered) noexcept;
  Status CheckTorque(Tendon& tendon, const DriveFeedback& drive, bool powered) noexcept;
  Status CheckCell(std::size_t j, const DriveFeedback& drive, const CycleOutput& output,
                   bool powered) noexcept;
  Status CheckShape(const CycleOutput& output, const Expectation& expected) noexcept;
  double MotorTension(std::size_t j, const CycleOutput& output) const noexcept;
  bool OverTension(std::size_t j, double reading_N) noexcept;
  /// Counts consecutive broken cycles; true once there are `cycles` of them.
  bool Confirmed(Tendon& tendon, Rule rule, bool broken, std::int32_t cycles) const noexcept;

  GuardParameters parameters_;
  const model::Body& body_;
  const std::vector<std::shared_ptr<const model::CapstanTable>>& tables_;
  TimeNs period_ns_;
  double max_tension_N_, max_base_N_, max_bending_rad_;
  TendonVector rest_N_;
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
