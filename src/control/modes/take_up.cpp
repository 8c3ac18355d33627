#include "tendril/control/take_up.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "../tendon_side.h"
#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// Speed is averaged over this many cycles: fast enough to damp a bare rotor, slow enough to smooth the
// encoder's quantisation.
constexpr double kWindingSpeedCycles = 5;
// Share of max_speed_mps up to which the full pull acts, so that oscillation about rest is not excited.
constexpr double kUnfaded = 0.4;
// A motor stands when it has moved less than kStanding_m for this long.
constexpr std::int32_t kStandingCycles = 500;
constexpr double kStanding_m = 2e-5;
// A motor within this of its start did not turn; compliance of gear and tendon is smaller.
constexpr double kNotTurned_m = 2e-4;
// Share of the motor's friction that moves any free motor, beside the tension on it.
constexpr double kBreakaway = 1.4;
// Band around the pretension, as its share, that counts as at pretension; friction allows no finer control.
constexpr double kBand = 0.3;

}  // namespace

double TakeUp::Tendon::TravelM() const noexcept {
  return CountsMoved(counts, start_counts) * travel_per_count_m;
}

TakeUp::TakeUp(const RobotParameters& robot, const TakeUpParameters& parameters, double ramp_Nps,
               double settle_s, TimeNs period_ns)
    : parameters_(parameters),
      pretension_N_(robot.limits.min_tension_N),
      step_N_(ramp_Nps * ToSeconds(period_ns)),
      period_s_(ToSeconds(period_ns)),
      settle_cycles_(static_cast<std::int32_t>(settle_s / period_s_) + 1),
      timeout_cycles_(static_cast<std::int32_t>(parameters.timeout_s / period_s_) + 1) {
  for (const TendonDriveParameters& t : robot.actuation->tendons) {
    tendons_.push_back({.travel_m = t.SpoolTravelPerMotorRad(),
                        .travel_per_count_m = TravelPerCount(t),
                        .friction_N = FrictionAtSpool(t),
                        .efficiency = t.gear.efficiency,
                        .cell = t.load_cell.place != LoadCellPlace::kNone,
                        .in_pair = robot.actuation->PairOf(static_cast<int>(tendons_.size())) != nullptr});
  }
}

void TakeUp::Start(const CycleInput& input) noexcept {
  homing_for_ = settled_for_ = blamed_ = 0;
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    Tendon& t = tendons_[j];
    t.start_counts = t.counts = t.standing_counts = input.drive[j].position_counts;
    t.speed_mps = 0;
    t.standing_for = t.same_for = 0;
    t.taut = t.in_pair;
  }
}

Status TakeUp::Watch(const CycleInput& input) noexcept {
  Status status = Status::kOk;
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    Tendon& t = tendons_[j];
    const DriveFeedback& drive = input.drive[j];
    if (drive.age_cycles > 0) continue;
    const double speed_mps = CountsMoved(drive.position_counts, t.counts) * t.travel_per_count_m / period_s_;
    t.speed_mps += (speed_mps - t.speed_mps) / kWindingSpeedCycles;
    t.counts = drive.position_counts;
    if (std::abs(t.TravelM()) > parameters_.max_travel_m && status == Status::kOk) {
      status = Status::kTravelOverLimit;
      blamed_ = static_cast<std::int32_t>(j) + 1;
    }
  }
  return status;
}

double TakeUp::Torque(int tendon, double pull_N) const noexcept {
  const Tendon& t = tendons_[static_cast<std::size_t>(tendon)];
  const double share = std::abs(t.speed_mps) / parameters_.max_speed_mps;
  const double fade = std::clamp((1 - share) / (1 - kUnfaded), 0., 1.);
  return std::clamp(pull_N, -parameters_.pull_N, parameters_.pull_N) * t.travel_m * fade;
}

void TakeUp::Ramp(const TendonVector& target_N, TendonVector& pull_N) const noexcept {
  for (Eigen::Index j = 0; j < pull_N.size(); ++j) {
    // Reducing a pull needs no ramp: a motor commanded to stop must not wind on.
    if (pull_N[j] > 0) pull_N[j] = std::min(pull_N[j], std::max(0., target_N[j]));
    if (pull_N[j] < 0) pull_N[j] = std::max(pull_N[j], std::min(0., target_N[j]));
    pull_N[j] += std::clamp(target_N[j] - pull_N[j], -step_N_, step_N_);
  }
}

Status TakeUp::Home(const CycleInput& input, const CycleOutput& output, TendonVector& pull_N) noexcept {
  Status status = Watch(input);
  if (status == Status::kTravelOverLimit) {
    // It moved freely: the tendon is broken, or slacker than allowed.
    const Tendon& t = tendons_[static_cast<std::size_t>(blamed_ - 1)];
    return !t.taut && t.TravelM() > 0 ? Status::kTendonBroken : status;
  }
  bool settled = true;
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    Tendon& t = tendons_[j];
    const auto at = static_cast<Eigen::Index>(j);
    const double error_N = pretension_N_ - output.tension_measured_N[at];
    double target_N = t.taut ? pull_N[at] : parameters_.pull_N;
    if (!t.taut) {
      const Status s = Judge(t, input.drive[j], output.tension_measured_N[at], pull_N[at]);
      if (s != Status::kOk && status == Status::kOk) {
        status = s;
        blamed_ = static_cast<std::int32_t>(j) + 1;
      }
      t.taut = t.taut || (t.cell && error_N <= 0);
      // The pull of the take-up may exceed the pretension; reduce it at once.
      if (t.taut) target_N = pull_N[at] = std::min(pull_N[at], pretension_N_);
    } else if (t.cell && std::abs(error_N) > kBand * pretension_N_) {
      target_N = std::copysign(parameters_.pull_N, error_N);
      settled = false;
    }
    settled = settled && t.taut;
    pull_N[at] += std::clamp(target_N - pull_N[at], -step_N_, step_N_);
  }
  settled_for_ = settled ? settled_for_ + 1 : 0;
  if (status != Status::kOk || homed()) return status;
  blamed_ = 0;
  return ++homing_for_ > timeout_cycles_ ? Status::kHomingTimedOut : Status::kOk;
}

// Checks the progress of a tendon that is not taut yet.
Status TakeUp::Judge(Tendon& t, const DriveFeedback& drive, double shown_N, double pull_N) noexcept {
  // Without encoder counts the speed is unbounded: limit the torque to what must move it.
  const double breakaway_N = kBreakaway * t.friction_N + std::max(shown_N, pretension_N_) / t.efficiency;
  const bool counted = std::abs(CountsMoved(t.counts, t.start_counts)) > 1;
  if (!counted && pull_N > std::min(breakaway_N, 0.99 * parameters_.pull_N)) return Status::kTendonJammed;

  if (t.same_for == 0 || drive.analog_mV != t.cell_mV) {
    t.cell_mV = drive.analog_mV;
    t.same_for = 0;
  }
  t.same_for = std::min(t.same_for + 1, kRestingCycles);
  const bool full = pull_N > 0.99 * parameters_.pull_N;
  const double moved_m = std::abs(CountsMoved(t.counts, t.standing_counts)) * t.travel_per_count_m;
  if (!full || moved_m > kStanding_m) {
    t.standing_for = 0;
    t.standing_counts = t.counts;
  } else if (++t.standing_for >= kStandingCycles) {
    if (!t.cell) {
      t.taut = true;
      return Status::kOk;
    }
    const bool turned = std::abs(t.TravelM()) > kNotTurned_m;
    return turned || t.same_for >= kRestingCycles ? Status::kCellDead : Status::kTendonJammed;
  }
  return Status::kOk;
}

void TakeUp::Archive(StateArchive& a) noexcept {
  for (Tendon& t : tendons_) {
    a.Value(t.start_counts);
    a.Value(t.counts);
    a.Value(t.speed_mps);
    a.Value(t.standing_for);
    a.Value(t.standing_counts);
    a.Value(t.same_for);
    a.Value(t.cell_mV);
    a.Value(t.taut);
  }
  a.Value(homing_for_);
  a.Value(settled_for_);
  a.Value(blamed_);
}

}  // namespace tendril::control
