#include "tendril/control/tip_feedback.h"

#include <algorithm>
#include <cmath>

#include "state_archive.h"

namespace tendril::control {
namespace {

// Slow beside the robot's own swinging, which tension feedback damps, and beside the tracker.
constexpr double kFastest_s = 0.3;

}  // namespace

TipFeedback::TipFeedback(const TrackerParameters& tracker, double length_m, double period_s)
    : period_s_(period_s),
      time_constant_s_(std::max({kFastest_s, 10 / tracker.rate_Hz, 5 * tracker.delay_s})),
      reading_every_s_(1 / tracker.rate_Hz),
      max_age_s_(2 * tracker.delay_s + std::max(0.1, 5 / tracker.rate_Hz)),
      max_shift_m_(kMaxShare * length_m),
      wanted_(static_cast<std::size_t>(std::ceil((max_age_s_ + 0.02) / period_s)) + 2,
              Eigen::Vector3d::Zero()) {}

Status TipFeedback::Step(const TrackerSample& sample, TimeNs now_ns, TimeNs ahead_ns,
                         const Eigen::Vector3d& wanted_W_m, const Eigen::Vector3d& u,
                         const Eigen::Vector3d& v, bool acts) noexcept {
  if (!acts) {
    shift_W_m_.setZero();
    rate_W_mps_.setZero();
    filled_ = 0;
    silent_cycles_ = 0;
    return Status::kOk;
  }
  const auto size = static_cast<std::int32_t>(wanted_.size());
  next_ = (next_ + 1) % size;
  wanted_[next_] = wanted_W_m;
  filled_ = std::min(filled_ + 1, size);
  ++silent_cycles_;
  const double age_s = ToSeconds(now_ns - sample.time_ns);
  const bool usable = sample.valid && sample.tip_W_m.allFinite() && age_s >= 0 && age_s <= max_age_s_ &&
                      (last_ns_ == 0 || sample.time_ns > last_ns_);
  if (usable) {
    silent_cycles_ = 0;
    last_ns_ = sample.time_ns;
    rate_W_mps_.setZero();
    const double back = (age_s + ToSeconds(ahead_ns)) / period_s_;
    const int whole = static_cast<int>(back);
    if (whole + 1 < filled_) {  // else measured before anything was wanted
      const auto before = [&](int cycles) { return wanted_[(next_ - cycles + 2 * size) % size]; };
      const Eigen::Vector3d then = before(whole) + (back - whole) * (before(whole + 1) - before(whole));
      const Eigen::Vector3d error = then - sample.tip_W_m;
      rate_W_mps_ = (u * u.dot(error) + v * v.dot(error)) / time_constant_s_;
      const double speed = rate_W_mps_.norm();
      if (speed > kMaxRate_mps) rate_W_mps_ *= kMaxRate_mps / speed;
    }
  }
  // Between readings the correction goes on evenly, a torque that jumped with each of them would shake the
  // robot.
  const double silent_s = static_cast<double>(silent_cycles_) * period_s_;
  if (silent_s < reading_every_s_) shift_W_m_ += rate_W_mps_ * period_s_;
  const double far_m = shift_W_m_.norm();
  if (far_m > max_shift_m_) shift_W_m_ *= max_shift_m_ / far_m;
  if (silent_s > max_age_s_) return Status::kTrackerLost;
  return far_m > max_shift_m_ ? Status::kLimitedTipCorrection : Status::kOk;
}

void TipFeedback::Remember(StateArchive& a) noexcept {
  for (Eigen::Vector3d& w : wanted_) a.Vector(w);
  a.Value(next_);
  a.Value(filled_);
  a.Value(silent_cycles_);
  a.Value(last_ns_);
  a.Vector(shift_W_m_);
  a.Vector(rate_W_mps_);
  const auto size = static_cast<std::int32_t>(wanted_.size());
  a.Require(next_ >= 0 && next_ < size && filled_ >= 0 && filled_ <= size);
}

}  // namespace tendril::control
