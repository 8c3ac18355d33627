#include "tendril/control/tension_feedback.h"

#include <algorithm>
#include <cmath>

#include "../tendon_side.h"
#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// Below this share of the reference tension a tendon counts as slack, and the integral gain is multiplied.
constexpr double kSlackShare = 0.5, kSlackUrgency = 12;

// A motor that turned no more than this for this long stands; its torque is then kept free of cell noise.
constexpr std::int32_t kStoodCounts = 1, kStoodCycles = 100;

}  // namespace

TensionFeedback::TensionFeedback(const TendonDriveParameters& drive, const LimitParameters& limits,
                                 const TensionLoopGains& gains, int tendon, double period_s)
    : period_s_(period_s),
      proportional_(gains.proportional),
      integral_ps_(gains.integral_ps),
      cell_share_(gains.cell_filter_s > 0 ? 1 - std::exp(-period_s / gains.cell_filter_s) : 1),
      velocity_share_(gains.velocity_filter_s > 0 ? 1 - std::exp(-period_s / gains.velocity_filter_s) : 1),
      damping_Nms_(gains.damping_Nms[static_cast<std::size_t>(tendon)]),
      travel_m_(drive.SpoolTravelPerMotorRad()),
      rad_per_count_(RadPerCount(drive)),
      rest_band_N_(0.5 * FrictionAtSpool(drive)),
      most_N_(0.5 * limits.max_tension_base_N),
      torque_scale_(drive.motor.torque_scale) {}

void TensionFeedback::Reset() noexcept {
  reference_.fill({});
  error_N_ = integral_N_ = velocity_error_radps_ = limited_ = held_Nm_ = 0;
  stood_cycles_ = 0;
  running_ = false;
}

double TensionFeedback::Step(const DriveFeedback& feedback, double measured_N, const Reference& reference,
                             bool acts) noexcept {
  if (!acts) {
    Reset();
    return 0;
  }
  if (!running_) {
    reference_.fill(reference);
    counts_ = stood_at_counts_ = feedback.position_counts;
    running_ = true;
  }
  const Reference then = reference_[0];
  for (int i = 0; i + 1 < kDelayCycles; ++i) reference_[i] = reference_[i + 1];
  reference_[kDelayCycles - 1] = reference;

  const std::int32_t moved = CountsMoved(feedback.position_counts, counts_);
  if (std::abs(CountsMoved(feedback.position_counts, stood_at_counts_)) > kStoodCounts) {
    stood_at_counts_ = feedback.position_counts;
    stood_cycles_ = 0;
  } else {
    stood_cycles_ = std::min(stood_cycles_ + 1, kStoodCycles);
  }
  counts_ = feedback.position_counts;
  const double off_N = then.cell_N - measured_N;
  // Uncertain friction cannot explain a slack tendon.
  const bool slack = measured_N < kSlackShare * then.cell_N;
  const double uncertainty_N = slack ? 0 : then.uncertainty_N;
  const double certain_N = std::copysign(std::max(0.0, std::abs(off_N) - uncertainty_N), off_N);
  error_N_ += cell_share_ * (certain_N - error_N_);
  const double velocity_radps = moved * rad_per_count_ / period_s_;
  velocity_error_radps_ +=
      velocity_share_ * (then.motor_velocity_radps - velocity_radps - velocity_error_radps_);
  // At rest dry friction holds any torque within it; an integral that grew against it would disturb the robot
  // when the motion reverses, or make it hunt.
  const bool rests = then.rests && !slack && std::abs(error_N_) < rest_band_N_;
  if (rests && stood_cycles_ == kStoodCycles) return held_Nm_;
  if (!(limited_ * error_N_ > 0) && !rests) {
    // A slack tendon closes no loop, and the motor's friction may hold it there, so the error is weighted
    // more.
    const double urgency = slack ? kSlackUrgency : 1;
    integral_N_ = std::clamp(integral_N_ + urgency * integral_ps_ * period_s_ * error_N_, -most_N_, most_N_);
  }
  held_Nm_ = (travel_m_ * (proportional_ * error_N_ + integral_N_) + damping_Nms_ * velocity_error_radps_) /
             torque_scale_;
  return held_Nm_;
}

void TensionFeedback::Archive(StateArchive& a) noexcept {
  for (Reference& w : reference_) {
    a.Value(w.cell_N);
    a.Value(w.motor_velocity_radps);
    a.Value(w.uncertainty_N);
    a.Value(w.rests);
  }
  for (double* v : {&error_N_, &integral_N_, &velocity_error_radps_, &limited_}) a.Value(*v);
  a.Value(counts_);
  a.Value(stood_at_counts_);
  a.Value(stood_cycles_);
  a.Value(held_Nm_);
  a.Value(running_);
}

}  // namespace tendril::control
