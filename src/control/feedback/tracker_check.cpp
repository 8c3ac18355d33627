#include "tracker_check.h"

#include <algorithm>

#include "tendril/control/state_archive.h"
#include "tendril/control/tip_feedback.h"

namespace tendril::control {

constexpr double kDisagrees_s = 0.5;

TrackerCheck::TrackerCheck(const RobotParameters& robot) : tracked_(robot.actuation->tracker.has_value()) {
  if (!tracked_) return;
  const TrackerParameters& tracker = *robot.actuation->tracker;
  allowed_m_ = TipFeedback::kMaxDisagreement * robot.body.length_m();
  late_readings_ = tracker.delay_s * tracker.rate_Hz;
  most_ = 1 + static_cast<std::int32_t>(kDisagrees_s * tracker.rate_Hz);
}

Status TrackerCheck::Step(const TrackerSample& seen, const Eigen::Vector3d& estimate_W_m,
                          bool applies) noexcept {
  if (!tracked_ || !applies) {
    disagreeing_ = 0;
    return Status::kOk;
  }
  if (seen.valid && seen.tip_W_m.allFinite()) {
    // Readings are late by the tracker's delay, during which the tip moves.
    const double moved_m = (estimate_W_m - compared_W_m_).norm();
    const double late_m = moved_m * (1 + late_readings_);
    const bool off = (seen.tip_W_m - estimate_W_m).norm() > allowed_m_ + late_m;
    compared_W_m_ = estimate_W_m;
    disagreeing_ = off ? std::min(disagreeing_ + 1, most_) : 0;
    disagrees_ = disagreeing_ == most_;
  }
  return disagrees_ && disagreeing_ > 0 ? Status::kTrackerDisagrees : Status::kOk;
}

void TrackerCheck::Archive(StateArchive& a) noexcept {
  a.Value(disagreeing_);
  a.Value(disagrees_);
  a.Vector(compared_W_m_);
}

}  // namespace tendril::control
