#include "drive_torques.h"

#include <algorithm>
#include <cmath>

#include "../report.h"
#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// A slower reference counts as at rest: a micrometre of tendon in ten seconds.
constexpr double kRest_mps = 1e-7, kRest_Nps = 1e-3;
constexpr double kHeldPermille = 0.8;
// Share of the motor's friction, which alone holds a spool without tension, that the torque may pay out
// against; below one, because the robot file may overstate it.
constexpr double kPaidOut = 0.5;
constexpr double kCellDoubt_N = 0.5;
// A spool faster than this while its cell shows no tension has lost its tendon.
constexpr double kLost_mps = 0.01;
// Decay of the extra minimum tension after fast motion: the next fast motion may follow soon, and the robot
// still oscillates.
constexpr double kRotorFades_Nps = 3;
// Time constant of what friction adds to a pair's tensions. It moves their bounds, hence the command, hence
// the friction: slow against the cycle, so that bound and command do not alternate, and quick against a
// motion.
constexpr double kOffset_s = 0.05;

}  // namespace

DriveTorques::DriveTorques(const RobotParameters& robot, const ControllerParameters& parameters,
                           const Tables& tables, bool feeds_forward,
                           const std::optional<TensionLoopGains>& gains, double period_s)
    : robot_(robot),
      parameters_(parameters),
      tables_(tables),
      tendons_(robot.body.tendons()),
      period_s_(period_s),
      pairs_(robot),
      pull_N_(TendonVector::Zero(tendons_)),
      path_m_(pull_N_),
      arc_m_(pull_N_),
      unpulled_N_(pull_N_),
      pair_offset_N_(pull_N_),
      last_reference_N_(pull_N_),
      last_reference_m_(last_reference_N_),
      last_displacement_m_(last_reference_N_) {
  const bool capstan = parameters.capstan_compensation;
  for (int j = 0; j < tendons_; ++j) {
    const TendonDriveParameters& drive = robot.actuation->tendons[j];
    compensation_.emplace_back(drive, robot.limits, capstan, PulledBy(j));
    if (!feeds_forward) continue;
    feed_forward_.emplace_back(drive, robot.limits, capstan, PulledBy(j), period_s);
    if (gains) feedback_.emplace_back(drive, robot.limits, *gains, j, period_s);
  }
}

// The second tendon of a pair has no torque; its entry only keeps tendons' order.
Pulled DriveTorques::PulledBy(int j) const {
  const auto& tendons = robot_.actuation->tendons;
  for (const auto& pair : pairs_.all()) {
    if (pair.first == j) return {pair, tendons[j], tendons[pair.second], tables_[j], tables_[pair.second]};
  }
  return {tendons[j], robot_.limits.min_tension_N, tables_[j]};
}

void DriveTorques::Reset(const TendonVector& shortening_m) noexcept {
  rotor_N_ = 0;
  for (int j = 0; j < tendons_; ++j) {
    compensation_[j].Reset(0, 0);
    if (shortening_m[j] != 0) compensation_[j].Step(0, shortening_m[j], true);
  }
  for (auto& k : feed_forward_) k.Reset(0, 0);
  for (auto& k : feedback_) k.Reset();
  pair_offset_N_.setZero();
  last_fed_back_Nm_.fill(0);
  fed_back_at_N_.fill(0);
}

void DriveTorques::Step(const Cycle& cycle, CycleOutput& output) noexcept {
  rests_ = Rests(output, cycle.tension_N);
  most_rotor_N_ = 0;
  pull_N_ = cycle.tension_N;
  path_m_ = output.displacement_desired_m;
  arc_m_ = cycle.arc_shortening_m;
  for (const auto& pair : pairs_.all()) JoinPair(pair, output);
  for (int j = 0; j < tendons_; ++j) {
    Compensation::Result r = Torque(j, cycle, output);
    if (LostTendon(j, cycle, output)) r.torque_Nm = 0;
    output.sliding_direction[j] = r.sliding;
    output.tension_desired_motor_N[j] = r.tension_motor_N;
    output.torque_desired_Nm[j] = r.torque_Nm;
    Report(output, r.status);
  }
  for (const auto& pair : pairs_.all()) PartPair(pair, cycle.bare != nullptr, output);
  rotor_N_ = std::max(most_rotor_N_, rotor_N_ - kRotorFades_Nps * period_s_);
  last_displacement_m_ = output.displacement_m;
}

// A pair becomes what its motor pulls.
void DriveTorques::JoinPair(const model::TendonPairs::Pair& pair, const CycleOutput& output) noexcept {
  const double a = pair.first_share, b = 1 - a;
  unpulled_N_[pair.first] = model::TendonPairs::Unpulled_N(pair, output.displacement_desired_m);
  compensation_[pair.first].map().SetUnpulled(unpulled_N_[pair.first]);
  if (!feed_forward_.empty()) feed_forward_[pair.first].map().SetUnpulled(unpulled_N_[pair.first]);
  pull_N_[pair.first] -= pull_N_[pair.second];
  path_m_[pair.first] = a * path_m_[pair.first] - b * path_m_[pair.second];
  arc_m_[pair.first] = a * arc_m_[pair.first] - b * arc_m_[pair.second];
}

// What the motor pulls becomes the tensions of both. Friction changes what they have at the base, for the
// springs share the pull on the motor's side of the pulleys. Of bare motors each tendon has its own pull
// here.
void DriveTorques::PartPair(const model::TendonPairs::Pair& pair, bool bare, CycleOutput& output) noexcept {
  TendonVector& torque_Nm = output.torque_desired_Nm;
  torque_Nm[pair.first] -= torque_Nm[pair.second];
  torque_Nm[pair.second] = -torque_Nm[pair.first];
  if (bare) return;
  const model::PullMap& map = compensation_[pair.first].map();
  const double pull_N = output.tension_desired_motor_N[pair.first], z = output.sliding_direction[pair.first];
  const auto at_motor = map.AtMotor(pull_N), at_base = map.AtBase(pull_N, z);
  output.tension_desired_motor_N[pair.first] = std::max(0., at_motor.first_N);
  output.tension_desired_motor_N[pair.second] = std::max(0., at_motor.second_N);
  output.sliding_direction[pair.second] = -z;
  const double offset_N = (1 - pair.first_share) * at_base.first_N + pair.first_share * at_base.second_N -
                          unpulled_N_[pair.first];
  double& offset = pair_offset_N_[pair.first];
  offset += std::min(1.0, period_s_ / kOffset_s) * (offset_N - offset);
  pair_offset_N_[pair.second] = offset;
}

Compensation::Result DriveTorques::Torque(int j, const Cycle& cycle, const CycleOutput& output) noexcept {
  if (cycle.bare != nullptr) {
    return {.tension_motor_N = std::max(0., cycle.tension_N[j]),
            .torque_Nm = cycle.bare->Torque(j, cycle.tension_N[j])};
  }
  if (!robot_.actuation->HasDrive(j)) return {};
  if (!feed_forward_.empty()) return FeedForward(j, cycle, output);
  return compensation_[j].Step(pull_N_[j], path_m_[j], cycle.moving);
}

Compensation::Result DriveTorques::FeedForward(int j, const Cycle& cycle,
                                               const CycleOutput& output) noexcept {
  const auto commanded = feed_forward_[j].Step(pull_N_[j], path_m_[j], arc_m_[j],
                                               cycle.moving || cycle.mode == Mode::kPretension);
  Compensation::Result r = commanded;
  most_rotor_N_ = std::max(most_rotor_N_, std::abs(commanded.rotor_N));
  if (!feedback_.empty()) {
    const double measured_N = output.tension_measured_N[j];
    r.torque_Nm =
        LimitTorque(j, FeedbackTorque(j, cycle, measured_N, commanded), measured_N, commanded, r.status);
  }
  return r;
}

// Uncertainty of the motor-side tension until the pulleys have slid fully, after arming or a reversal:
// tracking a guess of friction with a motor-side cell would move the base tension.
double DriveTorques::FrictionUncertainty_N(int j, double tension_N, double sliding) const noexcept {
  if (!parameters_.capstan_compensation) return 0;
  const double range_N = tables_[j]->Pull(tension_N) - tables_[j]->Release(tension_N);
  return 0.5 * (1 - std::abs(sliding)) * range_N;
}

// Torque from the load cell's error, compared on the cell's side of the pulleys.
double DriveTorques::FeedbackTorque(int j, const Cycle& cycle, double measured_N,
                                    const DriveFeedForward::Result& commanded) noexcept {
  const double tension_N = cycle.tension_N[j];
  const bool at_motor = robot_.actuation->tendons[j].load_cell.place == LoadCellPlace::kMotorSide;
  const double fed_back_Nm = feedback_[j].Step(
      cycle.input.drive[j], measured_N,
      {.cell_N = at_motor ? commanded.tension_motor_N : tension_N,
       .motor_velocity_radps = commanded.motor_velocity_radps,
       .uncertainty_N = at_motor ? FrictionUncertainty_N(j, tension_N, commanded.sliding) : 0,
       .rests = rests_},
      cycle.controls_shape);
  if (cycle.controls_shape) {
    last_fed_back_Nm_[j] = fed_back_Nm;
    fed_back_at_N_[j] = tension_N;
    return fed_back_Nm;
  }
  // On the way down the correction shrinks with the tension; dropping it at once would jerk a motor stronger
  // than its file states. After a fault, which may be the cell's, it adds no pull.
  const bool stops = cycle.mode == Mode::kSafeStop || cycle.mode == Mode::kFault;
  if (!stops || !(fed_back_at_N_[j] > 0)) return 0;
  const double left_Nm = last_fed_back_Nm_[j] * std::clamp(tension_N / fed_back_at_N_[j], 0., 1.);
  return cycle.mode == Mode::kFault ? std::min(0., left_Nm) : left_Nm;
}

// Limits the torque to the drive's current, and from below to what leaves the tendon without tension, unless
// the motion pays out or the cell shows more than its own error: otherwise a small cell offset would unwind
// the spool. The feedback is informed of the saturation.
double DriveTorques::LimitTorque(int j, double fed_back_Nm, double measured_N,
                                 const DriveFeedForward::Result& commanded, Status& status) noexcept {
  const TendonDriveParameters& drive = robot_.actuation->tendons[j];
  const double most_Nm = compensation_[j].max_torque_Nm();
  const double unpulled_Nm = commanded.unloaded_Nm - kPaidOut * drive.motor.coulomb_friction_Nm;
  const double certain_Nm = drive.SpoolTravelPerMotorRad() * std::max(0., measured_N - kCellDoubt_N);
  const double least_Nm = std::max(-most_Nm, std::min(commanded.torque_Nm, unpulled_Nm) - certain_Nm);
  const double torque_Nm = commanded.torque_Nm + fed_back_Nm;
  const double bounded_Nm = std::clamp(torque_Nm, least_Nm, most_Nm);
  feedback_[j].Limited(torque_Nm - bounded_Nm);
  if (std::abs(bounded_Nm) == most_Nm && torque_Nm != bounded_Nm) status = Status::kLimitedTorque;
  return bounded_Nm;
}

// After a fault the tensions ramp down. A spool that has lost its tendon's tension would wind it in and jerk
// it beyond every limit, so its motor is released until the cell shows tension again. Either sensor may be
// the cause of the fault, so both must agree, and neither is fed back.
bool DriveTorques::LostTendon(int j, const Cycle& cycle, const CycleOutput& output) noexcept {
  if (pairs_.Has(j)) return false;  // its tension is not measured
  const bool slack = cycle.mode == Mode::kFault && cycle.zeroed && cycle.bare == nullptr &&
                     output.tension_measured_N[j] < parameters_.guards.slack_tension_N;
  const bool runs = std::abs(output.displacement_m[j] - last_displacement_m_[j]) > kLost_mps * period_s_;
  lost_[j] = slack && (lost_[j] || runs);
  return lost_[j];
}

// Neither shape nor tension references move, within kRest.
bool DriveTorques::Rests(const CycleOutput& output, const TendonVector& tension_N) noexcept {
  const double moved_m = (output.displacement_desired_m - last_reference_m_).cwiseAbs().maxCoeff();
  const double changed_N = (tension_N - last_reference_N_).cwiseAbs().maxCoeff();
  last_reference_m_ = output.displacement_desired_m;
  last_reference_N_ = tension_N;
  return moved_m < kRest_mps * period_s_ && changed_N < kRest_Nps * period_s_;
}

void DriveTorques::Send(bool powered, CycleOutput& output) noexcept {
  for (int j = 0; j < tendons_; ++j) {
    const double rated_Nm = robot_.actuation->tendons[j].drive.rated_torque_Nm;
    const double permille = powered ? output.torque_desired_Nm[j] / rated_Nm * 1000 : 0;
    output.torque_target_permille[j] = Round(j, permille);
    const bool carried = !feed_forward_.empty() && !rests_ && permille != 0;
    const double left_over = permille + permille_left_over_[j] - output.torque_target_permille[j];
    permille_left_over_[j] = carried ? std::clamp(left_over, -0.5, 0.5) : 0;
    sent_permille_[j] = output.torque_target_permille[j];
  }
  for (const TendonPair& pair : robot_.actuation->pairs) {
    auto& permille = output.torque_target_permille;
    permille[pair.second] = static_cast<std::int16_t>(-permille[pair.first]);
  }
}

// While the robot moves, the rounding remainder carries over to the next cycle: one torque step on the bus is
// 14 mN of tendon tension here, and the mean over a few cycles matters. At rest this dither would shake the
// robot through its dry friction, so the target is held until it differs by more than rounding and noise.
std::int16_t DriveTorques::Round(int j, double permille) const noexcept {
  permille = std::clamp(permille, -32767., 32767.);
  if (feed_forward_.empty()) return static_cast<std::int16_t>(std::lround(permille));
  if (rests_ && permille != 0 && std::abs(permille - sent_permille_[j]) < kHeldPermille)
    return sent_permille_[j];
  return static_cast<std::int16_t>(
      std::lround(std::clamp(permille + permille_left_over_[j], -32767., 32767.)));
}

void DriveTorques::Archive(StateArchive& a) noexcept {
  for (Compensation& k : compensation_) k.Archive(a);
  for (DriveFeedForward& k : feed_forward_) k.Archive(a);
  for (TensionFeedback& k : feedback_) k.Archive(a);
  a.Value(rotor_N_);
  if (!pairs_.empty()) a.Vector(pair_offset_N_, {tendons_});
  a.Vector(last_reference_N_, {tendons_});
  a.Vector(last_reference_m_, {tendons_});
  a.Vector(last_displacement_m_, {tendons_});
  for (int j = 0; j < tendons_; ++j) {
    a.Value(lost_[j]);
    a.Value(last_fed_back_Nm_[j]);
    a.Value(fed_back_at_N_[j]);
    a.Value(permille_left_over_[j]);
    a.Value(sent_permille_[j]);
  }
}

}  // namespace tendril::control
