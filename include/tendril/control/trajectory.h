// Jerk-limited trajectory from a target that may jump: the target is followed at a limited rate and averaged
// twice over fixed windows, so that rate, acceleration and jerk of each section's (us, vs) stay within their
// limits for any input. Averaging delays by delay_ns(), so callers look that far ahead on moving targets.
// Knows nothing of the robot.
#pragma once

#include <cmath>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"

namespace tendril::control {

class StateArchive;

class Trajectory {
 public:
  /// Window lengths are 2 v/a and 2 a/j. Throws std::invalid_argument when a limit is not positive.
  Trajectory(int sections, const TrajectoryParameters& limits, double max_bending_rad, TimeNs period_ns);

  /// At rest at `bending_rad`.
  void Reset(const BendingVector& bending_rad) noexcept;

  /// One period towards `goal_rad`, which itself moves with `goal_rate_radps`. The gap closes at
  /// `speed_radps` beside that; the total rate is at most `most_radps`. Returns kLimitedBendingRate when the
  /// goal moves faster than max_rate_radps, kSlowedByTension when `most_radps` is the limit. No section is
  /// commanded beyond max_bending_rad, or farther beyond it than it was.
  Status Advance(const BendingVector& goal_rad, const BendingVector& goal_rate_radps, double speed_radps,
                 double most_radps = HUGE_VAL) noexcept;

  /// Comes to rest within the limits.
  void AdvanceToRest() noexcept;

  const BendingReference& reference() const noexcept { return reference_; }
  /// The point that the averages follow.
  const BendingVector& followed() const noexcept { return followed_; }
  /// A change of rate by v takes an acceleration of v / gather_s().
  double gather_s() const noexcept { return position_.samples() * period_s_; }
  TimeNs delay_ns() const noexcept { return delay_ns_; }
  /// Averaging shifts a smooth motion by this times its second derivative [s^2].
  double smoothing_s2() const noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  /// Moving average over the last n samples.
  class Window {
   public:
    Window(int values, int samples);
    void Fill(const BendingVector& value) noexcept;
    /// Pushes a sample and returns the one n samples ago.
    BendingVector Push(const BendingVector& value) noexcept;
    BendingVector Mean() const noexcept { return sum_ / samples_; }
    int samples() const noexcept { return samples_; }
    void Archive(StateArchive& archive) noexcept;

   private:
    int samples_;
    int next_ = 0;
    std::vector<BendingVector> ring_;
    BendingVector sum_;
  };

  void Average() noexcept;

  int sections_;
  double period_s_, max_rate_radps_, max_bending_rad_;
  TimeNs delay_ns_;
  Window position_;   // over 2 v/a
  Window mean_;       // over 2 a/j
  Window mean_rate_;  // same window, over the first average's rate
  BendingVector followed_;
  BendingReference reference_;
};

}  // namespace tendril::control
