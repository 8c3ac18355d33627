#include "tendril/control/guards.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "../tendon_side.h"
#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// A drive's analog input saturates at 10 V; a broken cable shows either rail or zero.
constexpr int kRail_mV = 9900;
// Spool speed is averaged over this many cycles to smooth the encoder's quantisation.
constexpr double kSpeedCycles = 20;
// Share of max_torque_error_N that counts as a commanded change while the feedback stays frozen.
constexpr double kFrozenChange = 0.1;
// Each taut cycle cancels this many slack ones.
constexpr std::int32_t kTautCounts = 10;

}  // namespace

Guards::Guards(const RobotParameters& robot, const GuardParameters& parameters, TimeNs period_ns,
               const model::Body& body, const std::vector<std::shared_ptr<const model::CapstanTable>>& tables)
    : parameters_(parameters),
      body_(body),
      tables_(tables),
      period_ns_(period_ns),
      max_tension_N_(robot.limits.max_tension_motor_N * (1 + parameters.tension_margin)),
      max_base_N_(robot.limits.max_tension_base_N * (1 + parameters.tension_margin)),
      max_bending_rad_(robot.limits.max_bending_rad + parameters.max_bending_excess_rad),
      rest_N_(model::RestTensions_N(robot)),
      slack_cycles_(static_cast<std::int32_t>(parameters.max_slack_s * 1e9 / static_cast<double>(period_ns)) +
                    1),
      q_(UnitVector::Zero(body.dof())),
      desired_m_(TendonVector::Zero(body.tendons())) {
  for (const TendonDriveParameters& t : robot.actuation->tendons) {
    const double travel_m = t.SpoolTravelPerMotorRad();
    tendons_.push_back({.travel_m = travel_m,
                        .travel_per_count_m = TravelPerCount(t),
                        .stiffness_Npm = t.tendon.stiffness_Npm,
                        .efficiency = t.gear.efficiency,
                        .coulomb_Nm = t.motor.coulomb_friction_Nm,
                        .torque_scale = t.motor.torque_scale,
                        .inertia_kg = t.motor.rotor_inertia_kgm2 / (travel_m * travel_m),
                        .rated_Nm = t.drive.rated_torque_Nm,
                        .place = t.load_cell.place,
                        .in_pair = robot.actuation->PairOf(static_cast<int>(tendons_.size())) != nullptr});
  }
}

void Guards::Restart() noexcept {
  desired_m_.setZero();
  for (Tendon& t : tendons_) {
    t.broken_for.fill(0);
    t.seen = false;
    t.speed_mps = t.acceleration_mps2 = 0;
    t.same_for = 0;
    t.asked.fill(0);
    t.frozen_for = 0;
  }
}

void Guards::Expect(const CycleOutput& output, const TendonVector& reference_m) noexcept {
  desired_m_ = reference_m;
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    auto& asked = tendons_[j].asked;
    std::copy_backward(asked.begin(), asked.end() - 1, asked.end());
    asked[0] = output.torque_target_permille[j];
  }
}

bool Guards::Confirmed(Tendon& t, Rule rule, bool broken, std::int32_t cycles) const noexcept {
  std::int32_t& count = t.broken_for[rule];
  count = broken ? std::min(count + 1, cycles) : 0;
  return count >= cycles;
}

Status Guards::Check(const CycleInput& input, const CycleOutput& output,
                     const Expectation& expected) noexcept {
  Status worst = CheckTime(input, expected.powered);
  blamed_ = 0;
  std::int32_t tendon = 0;
  const auto keep = [&](Status s) {
    if (worst != Status::kOk || s == Status::kOk) return;
    worst = s;
    blamed_ = tendon;
  };
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    Tendon& t = tendons_[j];
    const DriveFeedback& drive = input.drive[j];
    tendon = static_cast<std::int32_t>(j) + 1;
    if (drive.age_cycles > 0) {
      ++t.unheard;
      continue;  // its age is checked elsewhere
    }
    // A cell that is not verified yet may be wrong, but a reading beyond the limit is never ignored.
    if (expected.powered && OverTension(j, output.tension_measured_N[static_cast<Eigen::Index>(j)])) {
      keep(Status::kTensionOverLimit);
    }
    keep(CheckMotion(t, drive, expected.powered));
    keep(CheckTorque(t, drive, expected.powered));
    keep(CheckCell(j, drive, output, expected.powered && expected.trusted));
    const bool slack = expected.tensioned && !t.in_pair &&
                       output.tension_measured_N[static_cast<Eigen::Index>(j)] < parameters_.slack_tension_N;
    // Noise may show a slack tendon taut for a cycle, so the counter decays instead of restarting.
    std::int32_t& slack_for = t.broken_for[kSlack];
    slack_for = slack ? std::min(slack_for + 1, slack_cycles_) : std::max(slack_for - kTautCounts, 0);
    if (slack_for >= slack_cycles_) keep(Status::kTendonSlack);
  }
  tendon = 0;
  keep(CheckShape(output, expected));
  return worst;
}

// Time advances by whole periods. A skipped period is one without control.
Status Guards::CheckTime(const CycleInput& input, bool powered) noexcept {
  const TimeNs step_ns = input.time_ns - last_time_ns_;
  const bool known = timed_;
  timed_ = true;
  last_time_ns_ = input.time_ns;
  if (!known) return Status::kOk;
  const double period_s = ToSeconds(period_ns_);
  late_ = std::max(0., late_ - parameters_.max_late_cycles * period_s);
  behind_ = behind_ && late_ > 0;
  if (step_ns <= 0 || step_ns % period_ns_ != 0) return powered ? Status::kTimeStepped : Status::kOk;
  late_ += static_cast<double>(step_ns / period_ns_ - 1);
  if (late_ <= parameters_.max_late_cycles) return Status::kOk;
  late_ = parameters_.max_late_cycles;
  behind_ = true;
  return powered ? Status::kCyclesLate : Status::kOk;
}

Status Guards::CheckMotion(Tendon& t, const DriveFeedback& drive, bool powered) noexcept {
  const double moved_m = t.seen ? CountsMoved(drive.position_counts, t.counts) * t.travel_per_count_m : 0;
  const double cycles = t.unheard + 1.;
  t.seen = true;
  t.counts = drive.position_counts;
  t.unheard = 0;
  const double speed_mps = moved_m / (cycles * ToSeconds(period_ns_));
  const double share = std::min(1., cycles / kSpeedCycles);
  const double change_mps = (speed_mps - t.speed_mps) * share;
  t.speed_mps += change_mps;
  t.acceleration_mps2 += (change_mps / (cycles * ToSeconds(period_ns_)) - t.acceleration_mps2) * share;
  if (!powered) return Status::kOk;
  if (std::abs(moved_m) > parameters_.max_displacement_jump_m * cycles) return Status::kDisplacementJump;
  const bool fast = std::abs(t.speed_mps) > parameters_.max_displacement_rate_mps;
  return Confirmed(t, kOverSpeed, fast, parameters_.confirm_cycles) ? Status::kDisplacementRate : Status::kOk;
}

// A live drive reports the commanded torque a few cycles later. A hung drive repeats its last feedback, in
// all values or in its torque alone.
Status Guards::CheckTorque(Tendon& t, const DriveFeedback& drive, bool powered) noexcept {
  const double newton_per_permille = 1e-3 * t.rated_Nm / t.travel_m;
  const bool same = drive.position_counts == t.shown.position_counts &&
                    drive.torque_permille == t.shown.torque_permille && drive.analog_mV == t.shown.analog_mV;
  if (!powered || !same || t.frozen_for == 0) {
    t.shown = drive;
    t.frozen_for = 1;
    t.asked_since = t.asked[0];
  } else {
    t.frozen_for = std::min(t.frozen_for + 1, kRestingCycles);
  }
  // The torque may lie anywhere between the values commanded lately.
  const auto [least, most] = std::minmax_element(t.asked.begin(), t.asked.end());
  const int off = std::max({0, *least - drive.torque_permille, drive.torque_permille - *most});
  const bool beyond = powered && off * newton_per_permille > parameters_.max_torque_error_N;
  if (Confirmed(t, kTorque, beyond, parameters_.confirm_cycles)) return Status::kDriveFrozen;
  // Live feedback always changes by a digit while the commanded torque changes.
  const double change_N = std::abs(t.asked[0] - t.asked_since) * newton_per_permille;
  const bool frozen =
      t.frozen_for >= kRestingCycles && change_N > kFrozenChange * parameters_.max_torque_error_N;
  return powered && frozen ? Status::kDriveFrozen : Status::kOk;
}

// The motor's torque less the rotor's acceleration bounds the tension for either direction of friction; the
// cell must read within these bounds.
Status Guards::CheckCell(std::size_t j, const DriveFeedback& drive, const CycleOutput& output,
                         bool powered) noexcept {
  Tendon& t = tendons_[j];
  if (t.place == LoadCellPlace::kNone) return Status::kOk;
  const auto at = static_cast<Eigen::Index>(j);
  const double torque_Nm =
      t.torque_scale * output.torque_measured_Nm[at] - t.inertia_kg * t.acceleration_mps2 * t.travel_m;
  const double least_N = (torque_Nm - t.coulomb_Nm) / t.travel_m * t.efficiency;
  const double most_N = std::max(0., (torque_Nm + t.coulomb_Nm) / t.travel_m / t.efficiency);
  const double shown_N = MotorTension(j, output);
  const double reading_N = output.tension_measured_N[at];

  const double torque_N = output.torque_measured_Nm[at] / t.travel_m;
  if (!powered || t.same_for == 0 || drive.analog_mV != t.cell_mV) {
    t.cell_mV = drive.analog_mV;
    t.same_for = 1;
    t.least_torque_N = t.most_torque_N = torque_N;
  } else {
    t.same_for = std::min(t.same_for + 1, kRestingCycles);
    t.least_torque_N = std::min(t.least_torque_N, torque_N);
    t.most_torque_N = std::max(t.most_torque_N, torque_N);
  }
  if (!powered) return Status::kOk;

  const double allowed_N = parameters_.tension_disagreement_N;
  const bool nothing = std::abs(reading_N) <= parameters_.slack_tension_N && least_N > allowed_N;
  const bool off =
      std::abs(static_cast<int>(drive.analog_mV)) >= kRail_mV || reading_N < -allowed_N || nothing;
  if (Confirmed(t, kDisconnected, off, parameters_.confirm_cycles)) return Status::kSensorDisconnected;
  if (t.same_for >= kRestingCycles &&
      t.most_torque_N - t.least_torque_N > parameters_.stuck_torque_change_N) {
    return Status::kSensorStuck;
  }
  const bool beyond = shown_N < least_N - allowed_N || shown_N > most_N + allowed_N;
  return Confirmed(t, kDisagrees, beyond, parameters_.confirm_cycles) ? Status::kSensorDisagrees
                                                                      : Status::kOk;
}

// Bounds hold for any friction: the lower tension on the other side of the pulleys is compared. A tension
// inferred from the torque is off for moments, by what the rotor's acceleration and turning friction take.
bool Guards::OverTension(std::size_t j, double reading_N) noexcept {
  Tendon& t = tendons_[j];
  const double shown_N = std::max(reading_N, 0.);
  const bool at_robot = t.place == LoadCellPlace::kRobotSide;
  const double motor_N = at_robot ? tables_[j]->BaseToMotor(shown_N, -1) : shown_N;
  const double base_N = at_robot ? shown_N : tables_[j]->MotorToBase(shown_N, 1);
  const bool over = motor_N > max_tension_N_ || base_N > max_base_N_;
  return Confirmed(t, kOverTension, over, t.place == LoadCellPlace::kNone ? parameters_.confirm_cycles : 1);
}

// On the motor's side of the pulleys.
double Guards::MotorTension(std::size_t j, const CycleOutput& output) const noexcept {
  const double reading_N = output.tension_measured_N[static_cast<Eigen::Index>(j)];
  if (tendons_[j].place != LoadCellPlace::kRobotSide) return reading_N;
  // Middle between the tensions for pulling and for paying out.
  const double base_N = std::max(reading_N, 0.);
  return (tables_[j]->BaseToMotor(base_N, 1) + tables_[j]->BaseToMotor(base_N, -1)) / 2;
}

Status Guards::CheckShape(const CycleOutput& output, const Expectation& expected) noexcept {
  Tendon& first = tendons_.front();  // holds the counters of rules that concern no single tendon
  bool bent = false;
  for (int k = 0; k < body_.sections(); ++k) {
    bent = bent || output.bending_estimate_rad.segment<2>(2 * k).norm() > max_bending_rad_;
  }
  // The best-fit shape must reproduce the displacements of all tendons, which are not independent.
  double residual_m = 0;
  if (expected.tensioned) {
    TendonVector modelled_m(body_.tendons());
    body_.SpreadBending(output.bending_estimate_rad, q_);
    body_.TendonShortening(q_, modelled_m);
    for (std::size_t j = 0; j < tendons_.size(); ++j) {
      const auto at = static_cast<Eigen::Index>(j);
      const double stretch_m = (MotorTension(j, output) - rest_N_[at]) / tendons_[j].stiffness_Npm;
      // The spool of a slack tendon does not measure the shape.
      if (!tendons_[j].in_pair && output.tension_measured_N[at] < parameters_.slack_tension_N) {
        residual_m = 0;
        break;
      }
      const double gap_m = output.displacement_m[at] - stretch_m - modelled_m[at];
      residual_m = std::isfinite(gap_m) ? std::max(residual_m, std::abs(gap_m)) : HUGE_VAL;
    }
  }
  double error_m = 0;
  if (expected.follows) error_m = (desired_m_ - output.displacement_m).cwiseAbs().maxCoeff();

  const std::int32_t n = parameters_.confirm_cycles;
  Status status = Status::kOk;
  if (Confirmed(first, kFollowing, error_m > parameters_.max_following_error_m, n))
    status = Status::kFollowingError;
  if (Confirmed(first, kBending, expected.tensioned && bent, n)) status = Status::kBendingOverLimit;
  if (Confirmed(first, kEstimate, residual_m > parameters_.max_estimator_residual_m, n)) {
    status = Status::kEstimatorDiverged;
  }
  return status;
}

void Guards::Archive(StateArchive& a) noexcept {
  for (Tendon& t : tendons_) {
    for (std::int32_t& count : t.broken_for) a.Value(count);
    a.Value(t.seen);
    a.Value(t.counts);
    a.Value(t.unheard);
    a.Value(t.speed_mps);
    a.Value(t.acceleration_mps2);
    a.Value(t.cell_mV);
    a.Value(t.same_for);
    a.Value(t.least_torque_N);
    a.Value(t.most_torque_N);
    for (std::int16_t& asked : t.asked) a.Value(asked);
    a.Value(t.shown.position_counts);
    a.Value(t.shown.torque_permille);
    a.Value(t.shown.analog_mV);
    a.Value(t.frozen_for);
    a.Value(t.asked_since);
  }
  a.Vector(desired_m_, {body_.tendons()});
  a.Value(timed_);
  a.Value(last_time_ns_);
  a.Value(late_);
  a.Value(behind_);
  a.Value(blamed_);
}

}  // namespace tendril::control
