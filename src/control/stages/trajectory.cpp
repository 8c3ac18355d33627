#include "tendril/control/trajectory.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

int WindowSamples(double window_s, double period_s) {
  return std::max(1, static_cast<int>(std::ceil(window_s / period_s - 1e-9)));
}

const TrajectoryParameters& Checked(const TrajectoryParameters& limits) {
  if (!(limits.max_rate_radps > 0 && limits.max_acceleration_radps2 > 0 && limits.max_jerk_radps3 > 0)) {
    throw std::invalid_argument("trajectory limits must be positive");
  }
  return limits;
}

}  // namespace

Trajectory::Window::Window(int values, int samples)
    : samples_(samples), ring_(samples, BendingVector::Zero(values)), sum_(BendingVector::Zero(values)) {}

void Trajectory::Window::Fill(const BendingVector& value) noexcept {
  for (auto& v : ring_) v = value;
  sum_ = value * samples_;
}

BendingVector Trajectory::Window::Push(const BendingVector& value) noexcept {
  const BendingVector oldest = ring_[next_];
  ring_[next_] = value;
  if (++next_ == samples_) {
    next_ = 0;
    // A fresh sum once per window keeps rounding errors from accumulating.
    sum_.setZero();
    for (const auto& v : ring_) sum_ += v;
  } else {
    sum_ += value - oldest;
  }
  return oldest;
}

Trajectory::Trajectory(int sections, const TrajectoryParameters& limits, double max_bending_rad,
                       TimeNs period_ns)
    : sections_(sections),
      period_s_(ToSeconds(period_ns)),
      max_rate_radps_(Checked(limits).max_rate_radps),
      max_bending_rad_(max_bending_rad),
      position_(2 * sections,
                WindowSamples(2 * limits.max_rate_radps / limits.max_acceleration_radps2, period_s_)),
      mean_(2 * sections,
            WindowSamples(2 * limits.max_acceleration_radps2 / limits.max_jerk_radps3, period_s_)),
      mean_rate_(2 * sections, mean_.samples()) {
  delay_ns_ = period_ns * (position_.samples() - 1 + mean_.samples() - 1) / 2;
  Reset(BendingVector::Zero(2 * sections));
}

void Trajectory::Reset(const BendingVector& bending_rad) noexcept {
  followed_ = bending_rad;
  position_.Fill(bending_rad);
  mean_.Fill(bending_rad);
  mean_rate_.Fill(BendingVector::Zero(2 * sections_));
  reference_ = {bending_rad, BendingVector::Zero(2 * sections_), BendingVector::Zero(2 * sections_)};
}

Status Trajectory::Advance(const BendingVector& goal_rad, const BendingVector& goal_rate_radps,
                           double speed_radps, double most_radps) noexcept {
  // One factor for all sections, so that they arrive together along a straight line in (us, vs).
  const BendingVector gap = goal_rad - (followed_ + goal_rate_radps * period_s_);
  double largest_gap = 0;
  for (int k = 0; k < sections_; ++k) largest_gap = std::max(largest_gap, gap.segment<2>(2 * k).norm());
  const double closing = speed_radps * period_s_;
  BendingVector step = goal_rate_radps * period_s_;
  step += largest_gap > closing ? gap * (closing / largest_gap) : gap;

  double largest_step = 0;
  for (int k = 0; k < sections_; ++k) largest_step = std::max(largest_step, step.segment<2>(2 * k).norm());
  Status status = Status::kOk;
  const bool slowed = most_radps < max_rate_radps_;
  if (!slowed) most_radps = max_rate_radps_;
  if (largest_step > most_radps * period_s_ * (1 + 1e-12)) {
    step *= most_radps * period_s_ / largest_step;
    status = slowed ? Status::kSlowedByTension : Status::kLimitedBendingRate;
  }
  // An outward-moving goal may carry the followed point beyond the bound; limit it. The averages stay within
  // the bounds of what they average.
  for (int k = 0; k < sections_; ++k) {
    const double most = std::max(max_bending_rad_, followed_.segment<2>(2 * k).norm());
    followed_.segment<2>(2 * k) += step.segment<2>(2 * k);
    const double bend = followed_.segment<2>(2 * k).norm();
    if (bend > most) followed_.segment<2>(2 * k) *= most / bend;
  }
  Average();
  return status;
}

void Trajectory::AdvanceToRest() noexcept { Average(); }

// With y1 the followed point, y2 and y3 its first and second averages over n_a and n_j samples, the rates of
// y2 and y3 are differences across the windows: exact derivatives of the output, without numerical
// differentiation.
void Trajectory::Average() noexcept {
  const BendingVector left_position = position_.Push(followed_);
  const BendingVector y2 = position_.Mean();
  const BendingVector y2_rate = (followed_ - left_position) / (position_.samples() * period_s_);
  const BendingVector left_y2 = mean_.Push(y2);
  const BendingVector left_rate = mean_rate_.Push(y2_rate);
  const double window_s = mean_.samples() * period_s_;
  reference_.position_rad = mean_.Mean();
  reference_.velocity_radps = (y2 - left_y2) / window_s;
  reference_.acceleration_radps2 = (y2_rate - left_rate) / window_s;
}

void Trajectory::Window::Archive(StateArchive& a) noexcept {
  a.Value(next_);
  a.Require(next_ >= 0 && next_ < samples_);
  for (auto& v : ring_) a.Vector(v, {v.size()});
  a.Vector(sum_, {sum_.size()});
}

// A window of n samples T apart: (n^2 - 1) T^2 / 24.
double Trajectory::smoothing_s2() const noexcept {
  const double first = position_.samples(), second = mean_.samples();
  return (first * first + second * second - 2) * period_s_ * period_s_ / 24;
}

void Trajectory::Archive(StateArchive& a) noexcept {
  position_.Archive(a);
  mean_.Archive(a);
  mean_rate_.Archive(a);
  for (BendingVector* v :
       {&followed_, &reference_.position_rad, &reference_.velocity_radps, &reference_.acceleration_radps2}) {
    a.Vector(*v, {2 * sections_});
  }
}

}  // namespace tendril::control
