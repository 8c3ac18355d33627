#include "commanded_tensions.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tendril/control/state_archive.h"

namespace tendril::control {

// A tendon this close to pretension counts as released.
constexpr double kReleasedTension_N = 1e-6;

CommandedTensions::CommandedTensions(const RobotParameters& robot, double rate_Nps, double period_s,
                                     std::optional<TensionRamp> ramp)
    : min_tension_N_(robot.limits.min_tension_N),
      own_rate_Nps_(rate_Nps),
      period_s_(period_s),
      pairs_(robot),
      rest_N_(model::RestTensions_N(robot)),
      none_N_(rest_N_),
      ramp_(std::move(ramp)),
      rate_Nps_(rate_Nps) {
  for (int j = 0; j < none_N_.size(); ++j) {
    if (!pairs_.Has(j)) none_N_[j] = 0;
  }
  tension_N_ = none_N_;
}

bool CommandedTensions::Released() const noexcept {
  return (tension_N_ - Goal()).cwiseAbs().maxCoeff() <= kReleasedTension_N;
}

// Where tensions ramp down to.
TendonVector CommandedTensions::Goal() const noexcept {
  TendonVector goal_N = tension_N_.cwiseMin(min_tension_N_).cwiseMax(0);
  for (const auto& pair : pairs_.all()) {
    const double unpulled_N =
        tension_N_[pair.second] + (1 - pair.first_share) * (tension_N_[pair.first] - tension_N_[pair.second]);
    goal_N[pair.first] = goal_N[pair.second] = unpulled_N;
  }
  return goal_N;
}

void CommandedTensions::Reset() noexcept {
  SetToNone();
  joined_ = false;
  rate_Nps_ = own_rate_Nps_;
}

// True once there.
bool CommandedTensions::RampTo(const TendonVector& goal_N) noexcept {
  const double step_N = rate_Nps_ * period_s_;
  bool there = true;
  for (Eigen::Index j = 0; j < tension_N_.size(); ++j) {
    const double gap_N = goal_N[j] - tension_N_[j];
    there = there && std::abs(gap_N) <= step_N;
    tension_N_[j] += std::clamp(gap_N, -step_N, step_N);
  }
  return there;
}

void CommandedTensions::Follow(const TendonVector& source_N) noexcept {
  if (joined_) {
    tension_N_ = source_N;
  } else {
    joined_ = RampTo(source_N);
  }
}

void CommandedTensions::FollowCommand(const TendonVector& goal_N, bool starts) noexcept {
  if (ramp_) {
    if (starts) ramp_->Start(tension_N_);
    tension_N_ = ramp_->Step(goal_N, rate_Nps_ * period_s_);
  } else {
    RampTo(goal_N);
  }
  joined_ = false;
}

void CommandedTensions::RampDown(std::optional<double> within_s) noexcept {
  if (within_s) {
    const double left_s = std::max(*within_s, period_s_);
    rate_Nps_ = std::max(rate_Nps_, (tension_N_ - Goal()).maxCoeff() / left_s);
  }
  RampTo(Goal());
}

void CommandedTensions::Archive(StateArchive& a) noexcept {
  a.Vector(tension_N_, {tension_N_.size()});
  a.Value(rate_Nps_);
  a.Value(joined_);
  if (ramp_) ramp_->Archive(a);
}

}  // namespace tendril::control
