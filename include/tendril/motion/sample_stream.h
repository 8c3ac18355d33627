// Smooths samples that arrive irregularly into a motion slightly behind them: linear from one to the next,
// and at rest on the last. Knows nothing of where they come from.
#pragma once

#include <Eigen/Core>
#include <deque>

#include "tendril/core/clock.h"

namespace tendril::motion {

class SampleStream {
 public:
  /// `delay_ns`: lag of the motion behind the samples; at least the time between two of them, or it stops at
  /// each.
  explicit SampleStream(TimeNs delay_ns) : delay_ns_(delay_ns) {}

  /// Values of equal size; `arrived_ns` must not decrease. The sample expires at `arrived_ns + valid_for_ns`.
  void Add(TimeNs arrived_ns, const Eigen::VectorXd& value, TimeNs valid_for_ns);

  struct Point {
    Eigen::VectorXd value, rate;
  };
  /// Only after the first sample. `now_ns` must not decrease: past samples are discarded.
  Point At(TimeNs now_ns);
  bool empty() const { return samples_.empty(); }
  const Eigen::VectorXd& latest() const { return samples_.back().value; }
  /// Whether the last sample has expired at this time, so that the motion rests on it.
  bool Expired(TimeNs now_ns) const;

 private:
  struct Sample {
    TimeNs at_ns;
    Eigen::VectorXd value;
    TimeNs until_ns;
  };
  TimeNs delay_ns_;
  std::deque<Sample> samples_;
};

}  // namespace tendril::motion
