// From a target that may jump to a motion that may not: the target is followed at a limited rate and averaged
// twice over fixed windows, so that rate, acceleration and jerk of each section's (us, vs) stay within their
// limits whatever comes in. The averaging delays by delay_ns(); callers look that far ahead of moving
// targets. Knows nothing of the robot.
#pragma once

#include <cmath>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"

namespace tendril::control {

class StateArchive;

class Trajectory {
 public:
  /// Window lengths follow from the limits: 2 v/a and 2 a/j. Throws std::invalid_argument when a limit is not
  /// positive.
  Trajectory(int sections, const TrajectoryParameters& limits, double max_bending_rad, TimeNs period_ns);

  /// At rest at `bending_rad`.
  void Reset(const BendingVector& bending_rad) noexcept;

  /// One period towards `goal_rad`, which itself moves with `goal_rate_radps`, closing in at `speed_radps`
  /// beside that, no faster than `most_radps` in all. Returns kLimitedBendingRate when the goal moves faster
  /// than max_rate_radps allows, kSlowedByTension when it is `most_radps` that does not. No section is led
  /// beyond max_bending_rad, or further beyond than it was.
  Status Advance(const BendingVector& goal_rad, const BendingVector& goal_rate_radps, double speed_radps,
                 double most_radps = HUGE_VAL) noexcept;

  /// Comes to rest within the limits from wherever it is.
  void AdvanceToRest() noexcept;

  const BendingReference& reference() const noexcept { return reference_; }
  /// The point the averages run towards.
  const BendingVector& followed() const noexcept { return followed_; }
  /// A change of rate by v is made at an acceleration of v / gather_s().
  double gather_s() const noexcept { return position_.samples() * period_s_; }
  TimeNs delay_ns() const noexcept { return delay_ns_; }
  /// Averaging takes this much times its second derivative from a smooth motion [s^2].
  double smoothing_s2() const noexcept;

  void Remember(StateArchive& archive) noexcept;

 private:
  /// Moving average over the last n samples, with the sample that falls out.
  class Window {
   public:
    Window(int values, int samples);
    void Fill(const BendingVector& value) noexcept;
    /// Pushes a sample and returns the one n samples ago.
    BendingVector Push(const BendingVector& value) noexcept;
    BendingVector Mean() const noexcept { return sum_ / samples_; }
    int samples() const noexcept { return samples_; }
    void Remember(StateArchive& archive) noexcept;

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
  Window mean_rate_;  // the same window, on the first average's rate
  BendingVector followed_;
  BendingReference reference_;
};

}  // namespace tendril::control
