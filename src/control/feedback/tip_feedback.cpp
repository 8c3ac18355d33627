#include "tendril/control/tip_feedback.h"

#include <algorithm>
#include <cmath>

#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// Slow compared with the robot's oscillation, which tension feedback damps, and with the tracker.
constexpr double kFastest_s = 0.3;
// A live tracker's last digit changes within this time.
constexpr double kStuck_s = 0.2;
// Time constant for averaging the error before it is compared with the tracker's noise.
constexpr double kTipErrorFilter_s = 0.1;
// Smallest rest band as share of the robot's length: a better tracker does not reduce dry friction.
constexpr double kLeastRestBand = 5e-4;
constexpr double kRest_mps = 1e-5;
// A shift held at its limit may lie below it by rounding.
constexpr double kAtBound = 0.999;
constexpr std::int32_t kMostCycles = 1'000'000;

}  // namespace

TipFeedback::TipFeedback(const TrackerParameters& tracker, double length_m, double period_s)
    : period_s_(period_s),
      time_constant_s_(std::max({kFastest_s, 10 / tracker.rate_Hz, 5 * tracker.delay_s})),
      reading_every_s_(1 / tracker.rate_Hz),
      delay_s_(tracker.delay_s),
      max_age_s_(2 * tracker.delay_s + std::max(0.1, 5 / tracker.rate_Hz)),
      max_shift_m_(kMaxShare * length_m),
      max_disagreement_m_(kMaxDisagreement * length_m),
      rest_band_m_(std::max(kLeastRestBand * length_m, tracker.position_noise_m)),
      error_share_(1 - std::exp(-reading_every_s_ / kTipErrorFilter_s)),
      most_same_(tracker.position_noise_m > 0
                     ? std::max(3, static_cast<std::int32_t>(kStuck_s * tracker.rate_Hz))
                     : 0),
      reference_(static_cast<std::size_t>(std::ceil((max_age_s_ + 0.02) / period_s)) + 2,
                 Eigen::Vector3d::Zero()),
      estimate_(reference_) {}

// Value `cycles` ago, linearly interpolated.
Eigen::Vector3d TipFeedback::Before(const std::vector<Eigen::Vector3d>& ring, double cycles) const noexcept {
  const auto size = static_cast<std::int32_t>(ring.size());
  const int whole = static_cast<int>(cycles);
  const auto at = [&](int back) { return ring[(next_ - back + 2 * size) % size]; };
  return at(whole) + (cycles - whole) * (at(whole + 1) - at(whole));
}

// Rejects wrong units, a wrong frame, a swapped marker or a marker lost for long, all of which disagree with
// the tendons' estimate far more than a model error.
bool TipFeedback::Plausible(const TrackerSample& sample, double age_s) noexcept {
  same_ = (sample.tip_W_m.array() == last_tip_W_m_.array()).all() ? same_ + 1 : 1;
  same_ = std::min(same_, most_same_ + 1);
  last_tip_W_m_ = sample.tip_W_m;
  if (most_same_ > 0 && same_ > most_same_) return false;
  const double back = std::min(age_s / period_s_, filled_ - 2.0);
  return back < 0 || (sample.tip_W_m - Before(estimate_, back)).norm() <= max_disagreement_m_;
}

Status TipFeedback::Step(const TrackerSample& sample, TimeNs now_ns, TimeNs ahead_ns,
                         const Eigen::Vector3d& reference_W_m, const Eigen::Vector3d& estimate_W_m,
                         const Eigen::Vector3d& u, const Eigen::Vector3d& v, bool acts,
                         bool at_limit) noexcept {
  if (!acts) {
    for (Eigen::Vector3d* x : {&shift_W_m_, &rate_W_mps_, &target_rate_W_mps_, &error_W_m_}) x->setZero();
    filled_ = resting_cycles_ = 0;
    silent_cycles_ = 0;
    way_m_ = largest_m_ = 0;
    asleep_ = false;
    return Status::kOk;
  }
  const auto size = static_cast<std::int32_t>(reference_.size());
  const bool rests = filled_ > 0 && (reference_W_m - reference_[next_]).norm() < kRest_mps * period_s_;
  resting_cycles_ = rests ? std::min(resting_cycles_ + 1, kMostCycles) : 0;
  next_ = (next_ + 1) % size;
  reference_[next_] = reference_W_m;
  estimate_[next_] = estimate_W_m;
  filled_ = std::min(filled_ + 1, size);
  ++silent_cycles_;
  const double since_stamp_s = ToSeconds(now_ns - sample.time_ns), age_s = since_stamp_s + delay_s_;
  const bool fresh = sample.valid && sample.tip_W_m.allFinite() && since_stamp_s >= 0 &&
                     age_s <= max_age_s_ && (last_ns_ == 0 || sample.time_ns > last_ns_);
  if (fresh && Plausible(sample, age_s)) {
    silent_cycles_ = 0;
    last_ns_ = sample.time_ns;
    target_rate_W_mps_.setZero();
    const double back = (age_s + ToSeconds(ahead_ns)) / period_s_;
    if (static_cast<int>(back) + 1 < filled_) {  // else measured before the first reference
      const Eigen::Vector3d missing = Before(reference_, back) - sample.tip_W_m;
      const Eigen::Vector3d error = u * u.dot(missing) + v * v.dot(missing);
      error_W_m_ += error_share_ * (error - error_W_m_);
      if (resting_cycles_ <= back + 1) {
        asleep_ = false;
        way_m_ = largest_m_ = 0;
      } else {
        const double error_m = error_W_m_.norm();
        largest_m_ = std::max(largest_m_, error_m);
        const bool spent = way_m_ > kRestWay * largest_m_;
        const double band_m = spent ? std::max(rest_band_m_, largest_m_) : rest_band_m_;
        const bool slept = asleep_;
        // Not before it has settled: an error that crosses zero has not vanished.
        const bool settled = (resting_cycles_ - back) * period_s_ > time_constant_s_;
        asleep_ = settled && error_m <= (asleep_ ? kWake : 1) * band_m;
        if (spent && slept && !asleep_) way_m_ = 0;
      }
      if (!asleep_) target_rate_W_mps_ = error / time_constant_s_;
      const double speed = target_rate_W_mps_.norm();
      if (speed > kMaxRate_mps) target_rate_W_mps_ *= kMaxRate_mps / speed;
    }
  }
  // Between readings the correction continues at a rate without steps, because torque steps at each reading
  // would shake the robot.
  const double silent_s = static_cast<double>(silent_cycles_) * period_s_;
  if (silent_s >= reading_every_s_ || at_limit) target_rate_W_mps_.setZero();
  const Eigen::Vector3d faster_W_mps = target_rate_W_mps_ - rate_W_mps_;
  const double step_mps = kMaxAcceleration_mps2 * period_s_, change_mps = faster_W_mps.norm();
  rate_W_mps_ +=
      change_mps > step_mps ? Eigen::Vector3d(faster_W_mps * (step_mps / change_mps)) : faster_W_mps;
  shift_W_m_ += rate_W_mps_ * period_s_;
  way_m_ += rate_W_mps_.norm() * period_s_;
  const double far_m = shift_W_m_.norm();
  if (far_m > max_shift_m_) shift_W_m_ *= max_shift_m_ / far_m;
  if (silent_s > max_age_s_) return Status::kTrackerLost;
  const bool left = asleep_ && error_W_m_.norm() > kWake * rest_band_m_;
  // A shift held at its limit counts as limited.
  if (far_m > max_shift_m_ || (left && far_m > kAtBound * max_shift_m_)) return Status::kLimitedTipCorrection;
  return left ? Status::kTipErrorLeft : Status::kOk;
}

void TipFeedback::Archive(StateArchive& a) noexcept {
  for (Eigen::Vector3d& w : reference_) a.Vector(w);
  for (Eigen::Vector3d& e : estimate_) a.Vector(e);
  a.Value(next_);
  a.Value(filled_);
  a.Value(silent_cycles_);
  a.Value(last_ns_);
  a.Value(resting_cycles_);
  a.Value(same_);
  a.Value(way_m_);
  a.Value(largest_m_);
  a.Value(asleep_);
  for (Eigen::Vector3d* x : {&shift_W_m_, &rate_W_mps_, &target_rate_W_mps_, &error_W_m_, &last_tip_W_m_})
    a.Vector(*x);
  const auto size = static_cast<std::int32_t>(reference_.size());
  a.Require(next_ >= 0 && next_ < size && filled_ >= 0 && filled_ <= size);
}

}  // namespace tendril::control
