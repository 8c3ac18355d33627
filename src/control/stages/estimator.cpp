#include "tendril/control/estimator.h"

#include <algorithm>
#include <cmath>

#include "../tendon_side.h"
#include "tendril/control/state_archive.h"
#include "tendril/model/inverse.h"
#include "tendril/model/pull_cone.h"

namespace tendril::control {
namespace {

using ForceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, kMaxTendons>;

// Variance of a value rounded to a grid.
constexpr double RoundingVariance(double step) { return step * step / 12; }

// Readings below this many standard deviations of the cell count as no tension.
constexpr double kNoPullDeviations = 4;
// Variance of a taut tendon, for its weight against the prior.
constexpr double kPriorCount_m2 = 1e-7 * 1e-7;
// Time constant with which an unmeasured robot settles under its tensions; its oscillation is not faster.
constexpr double kSettles_s = 0.1;
// Time after which a tendon that was slack counts as taut; noise alone may show tension for a cycle.
constexpr double kGrips_s = 0.02;
// A slack section is not an arc; its tendon paths may differ from an arc's by this much.
constexpr double kNoArc_m = 2e-5;

// Variance of the friction between pulling and paying out, to the extent that it has not built up.
double FrictionVariance(double pulling_N, double paying_out_N, double z) {
  const double half_N = (pulling_N - paying_out_N) / 2;
  return std::max(0.0, 1 - z * z) * half_N * half_N / 3;
}

double SensorVariance(const TendonDriveParameters& t) {
  if (t.load_cell.place == LoadCellPlace::kNone) {
    const double permille2 =
        t.drive.actual_torque_noise_permille * t.drive.actual_torque_noise_permille + RoundingVariance(1);
    const double permille_N =
        1e-3 * t.motor.torque_scale * t.drive.rated_torque_Nm / t.SpoolTravelPerMotorRad();
    return permille2 * permille_N * permille_N;
  }
  if (!(t.load_cell.gain_VpN > 0)) return 0;
  const double step_N = std::max(1e-3, t.load_cell.resolution_V) / t.load_cell.gain_VpN;
  return t.load_cell.noise_N * t.load_cell.noise_N + RoundingVariance(step_N);
}

}  // namespace

Estimator::Estimator(const RobotParameters& robot, const model::Body& body,
                     const std::vector<std::shared_ptr<const model::CapstanTable>>& tables, double period_s,
                     const BendingMatrix& unseen_rad2)
    : body_(body),
      tables_(tables),
      pairs_(robot),
      min_tension_N_(robot.limits.min_tension_N),
      max_bending_rad_(robot.limits.max_bending_rad),
      straight_rad2_(max_bending_rad_ * max_bending_rad_ / 3),
      kept_(std::exp(-period_s / kSettles_s)),
      grips_(period_s / kGrips_s),
      averaged_(std::min(1.0, period_s / kZeroed_s)),
      stiffness_Nm_(2 * body.sections()),
      pulls_every_way_(model::PullsEveryWay(robot.body)),
      bend_per_N_(Eigen::MatrixXd::Zero(2 * body.sections(), body.tendons())),
      shortening_per_N_(Eigen::MatrixXd::Zero(body.tendons(), body.tendons())),
      rest_rad_(BendingVector::Zero(2 * body.sections())),
      rest_N_(model::RestTensions_N(robot)),
      rest_m_(TendonVector::Zero(body.tendons())),
      tension_base_N_(rest_m_),
      stretch_m_(rest_m_),
      unpulled_N_(rest_N_),
      pretension_rad_(rest_rad_),
      bending_rad_(rest_rad_),
      pretension_m_(rest_m_),
      shortening_m_(TendonVector::Zero(body.tendons())),
      weight_(TendonVector::Ones(body.tendons())),
      covariance_rad2_(BendingMatrix::Identity(2 * body.sections(), 2 * body.sections()) * straight_rad2_),
      unseen_rad2_(unseen_rad2),
      q_(UnitVector::Zero(body.dof())),
      unit_force_Nm_(q_) {
  if (!pulls_every_way_) FindPretension();
  for (int k = 0; k < body.sections(); ++k) {
    double softness = 0;
    for (int i = body.first_unit(k); i < body.end_unit(k); ++i) softness += 1 / body.unit_stiffness_Nm(i);
    stiffness_Nm_.segment<2>(2 * k).setConstant(1 / softness);
    const SectionParameters& section = robot.body.sections[static_cast<std::size_t>(k)];
    curvature_mprad2_.push_back(section.unit_length_m / (12 * section.units));
  }
  std::vector<double> levers_m;
  for (const auto& section : robot.body.sections) {
    for (const auto& route : section.tendons) levers_m.push_back(route.radius_m);
  }
  for (const auto& t : robot.actuation->tendons) {
    const double slack_N =
        std::max(kSlack * min_tension_N_, kNoPullDeviations * std::sqrt(SensorVariance(t)));
    const double range_m = levers_m[tendons_.size()] * max_bending_rad_;
    const double per_mV = t.load_cell.gain_VpN > 0 ? 1e-3 / t.load_cell.gain_VpN : 0;
    tendons_.push_back({TravelPerCount(t), t.drive.rated_torque_Nm, t.motor.torque_scale, per_mV,
                        t.load_cell.offset_N, t.tendon.stiffness_Npm, t.SpoolTravelPerMotorRad(),
                        t.gear.efficiency, t.motor.coulomb_friction_Nm, t.transmission.coulomb_N,
                        SensorVariance(t), t.load_cell.place, slack_N, range_m * range_m / 12, 1, 0, 0,
                        model::PulleyPresliding(t.transmission.presliding_m)});
  }
  for (const auto& pair : pairs_.all()) {
    tendons_[pair.first].share = pair.first_share;
    tendons_[pair.second].share = 1 - pair.first_share;
  }
}

void Estimator::FindPretension() {
  const auto at = [this](const Eigen::VectorXd& tension_N, auto&& bend_rad, auto&& shortening_m) {
    const Eigen::VectorXd q = model::RestShape(body_, tension_N);
    body_.SumBending(q, bend_rad);
    body_.TendonShortening(q, shortening_m);
  };
  const Eigen::VectorXd least_N = rest_N_;
  at(least_N, rest_rad_, rest_m_);
  for (int j = 0; j < body_.tendons(); ++j) {
    const double more_N = 0.1 * min_tension_N_;
    at(least_N + more_N * Eigen::VectorXd::Unit(body_.tendons(), j), bend_per_N_.col(j),
       shortening_per_N_.col(j));
    bend_per_N_.col(j) = (bend_per_N_.col(j) - rest_rad_) / more_N;
    shortening_per_N_.col(j) = (shortening_per_N_.col(j) - rest_m_) / more_N;
  }
  pretension_rad_ = rest_rad_;
  pretension_m_ = rest_m_;
}

void Estimator::ZeroDisplacement(const CycleInput& input) noexcept {
  TendonVector shown_m = pretension_m_;
  if (!pulls_every_way_) {
    // Dry friction leaves tendon tensions off the minimum, and the robot bent accordingly.
    const TendonVector over_N =
        (tension_base_N_ - rest_N_).cwiseMax(-min_tension_N_).cwiseMin(min_tension_N_);
    pretension_rad_ = rest_rad_ + bend_per_N_.lazyProduct(over_N);
    pretension_m_ = rest_m_ + shortening_per_N_.lazyProduct(over_N);
    shown_m = pretension_m_ + stretch_m_;
  }
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    const auto shown = std::lround(shown_m[static_cast<Eigen::Index>(j)] / tendons_[j].travel_per_count_m);
    tendons_[j].zero_counts = static_cast<std::int32_t>(
        static_cast<std::uint32_t>(input.drive[j].position_counts) - static_cast<std::uint32_t>(shown));
    tendons_[j].presliding.Reset(0);
    tendons_[j].taut = 1;
  }
  bending_rad_ = pretension_rad_;
  covariance_rad2_ = BendingMatrix::Identity(bending_rad_.size(), bending_rad_.size()) * straight_rad2_;
}

void Estimator::Step(const CycleInput& input, CycleOutput& output) noexcept {
  const int m = static_cast<int>(tendons_.size());
  TendonVector variance_m2(m);
  if (!pairs_.empty()) FindUnpulled();
  for (int j = 0; j < m; ++j) variance_m2[j] = ReadTendon(j, input.drive[j], output);
  if (weight_.minCoeff() == 1) {
    BendingWithAllTaut(output.tension_base_estimate_N, variance_m2);
  } else {
    BendingWithSlack(output.tension_base_estimate_N, variance_m2);
  }
  output.bending_covariance_rad2 = covariance_rad2_;
  if (unseen_rad2_.size() > 0) output.bending_covariance_rad2 += unseen_rad2_;
  body_.SpreadBending(bending_rad_, q_);
  const model::Pose tip = body_.TipPose(q_);
  output.bending_estimate_rad = bending_rad_;
  output.tip_estimate_W_m = tip.p_WA;
  output.orientation_estimate_WT = Eigen::Quaterniond(tip.R_WA);
}

// Variance of the shortening [m^2].
double Estimator::ReadTendon(int j, const DriveFeedback& d, CycleOutput& output) noexcept {
  Tendon& t = tendons_[j];
  const double pull_m = CountsMoved(d.position_counts, t.zero_counts) * t.travel_per_count_m;
  const double z = t.presliding.Commit(pull_m);
  const double torque_Nm = d.torque_permille * 1e-3 * t.rated_torque_Nm;
  const double cell_N = d.analog_mV * t.newton_per_mV - t.cell_offset_N;
  const Tension tension =
      t.in_pair() ? PairTension(j, z, torque_Nm) : TensionOf(t, *tables_[j], z, torque_Nm, cell_N);
  output.displacement_m[j] = pull_m;
  output.tension_measured_N[j] = t.place == LoadCellPlace::kNone ? tension.motor_N : cell_N;
  output.tension_base_estimate_N[j] = tension.base_N;
  tension_base_N_[j] += averaged_ * (tension.base_N - tension_base_N_[j]);
  output.torque_measured_Nm[j] = torque_Nm;
  const double stretch_m = (tension.motor_N - rest_N_[j]) / t.stiffness_Npm;
  stretch_m_[j] += averaged_ * (stretch_m - stretch_m_[j]);
  shortening_m_[j] = pull_m - stretch_m;
  const double over_N = std::max((kTaut - kSlack) * min_tension_N_, t.slack_N);
  const double pulls =
      t.place == LoadCellPlace::kNone ? 1 : std::clamp((cell_N - t.slack_N) / over_N, 0., 1.);
  t.taut = std::min(pulls, t.taut + grips_);
  weight_[j] = t.taut * t.taut;
  const double variance_m2 =
      2 * RoundingVariance(t.travel_per_count_m) + tension.variance_N2 / (t.stiffness_Npm * t.stiffness_Npm);
  return t.in_pair() ? 2 * variance_m2 : variance_m2;
}

void Estimator::FindUnpulled() noexcept {
  TendonVector modelled_m(body_.tendons());
  body_.SpreadBending(bending_rad_, q_);
  body_.TendonShortening(q_, modelled_m);
  for (const auto& pair : pairs_.all()) {
    unpulled_N_[pair.first] = unpulled_N_[pair.second] =
        std::max(0.0, model::TendonPairs::Unpulled_N(pair, modelled_m));
  }
}

// The motor holds the difference of the tensions at the spool, where the tendons' springs share it.
Estimator::Tension Estimator::PairTension(int j, double z, double torque_Nm) const noexcept {
  const Tendon& t = tendons_[j];
  const double pull_Nm = t.torque_scale * torque_Nm;
  const double lossless_N = (pull_Nm - t.coulomb_Nm * z) / t.travel_m;
  const double losses = std::pow(t.efficiency, lossless_N < 0 ? -z : z);
  Tension tension;
  tension.motor_N = std::max(0.0, unpulled_N_[j] + t.share * lossless_N * losses);
  tension.base_N = std::max(0.0, tables_[j]->MotorToBase(tension.motor_N, z) - t.pulley_coulomb_N * z);
  const double friction_N2 = FrictionVariance((pull_Nm + t.coulomb_Nm) / t.travel_m / t.efficiency,
                                              (pull_Nm - t.coulomb_Nm) / t.travel_m * t.efficiency, z);
  tension.variance_N2 = t.share * t.share * (t.sensor_variance_N2 * losses * losses + friction_N2);
  return tension;
}

// From the load cell, or without one from the torque; z is the state of the friction between the two sides.
Estimator::Tension Estimator::TensionOf(const Tendon& t, const model::CapstanTable& pulleys, double z,
                                        double torque_Nm, double cell_N) noexcept {
  const double bearing_N = t.pulley_coulomb_N * z;  // lost in the pulleys at any load
  const auto at_base = [&](double motor_N) {
    return std::max(0.0, pulleys.MotorToBase(motor_N, z) - bearing_N);
  };
  Tension tension{0, 0, t.sensor_variance_N2};
  switch (t.place) {
    case LoadCellPlace::kMotorSide:
      tension.motor_N = cell_N;
      tension.base_N = at_base(std::max(cell_N, 0.0));
      break;
    case LoadCellPlace::kRobotSide:
      tension.base_N = cell_N;
      tension.motor_N = pulleys.BaseToMotor(std::max(cell_N + bearing_N, 0.0), z);
      if (cell_N > 0) tension.variance_N2 = MotorSideVariance(t, pulleys, z, cell_N);
      break;
    case LoadCellPlace::kNone: {
      const double pull_Nm = t.torque_scale * torque_Nm, losses = std::pow(t.efficiency, z);
      tension.motor_N = std::max(0.0, (pull_Nm - t.coulomb_Nm * z) / t.travel_m * losses);
      tension.variance_N2 = t.sensor_variance_N2 * losses * losses +
                            FrictionVariance((pull_Nm + t.coulomb_Nm) / t.travel_m / t.efficiency,
                                             (pull_Nm - t.coulomb_Nm) / t.travel_m * t.efficiency, z);
      tension.base_N = at_base(tension.motor_N);
      break;
    }
  }
  return tension;
}

// Of a robot-side reading: slope of the map over one standard deviation to either side, and the friction.
double Estimator::MotorSideVariance(const Tendon& t, const model::CapstanTable& pulleys, double z,
                                    double base_N) noexcept {
  const double deviation_N = std::sqrt(t.sensor_variance_N2);
  const double low_N = std::max(0.0, base_N - deviation_N), high_N = base_N + deviation_N;
  const double spread_N = pulleys.BaseToMotor(high_N, z) - pulleys.BaseToMotor(low_N, z);
  return spread_N * spread_N / 4 +
         FrictionVariance(pulleys.BaseToMotor(base_N + t.pulley_coulomb_N, 1),
                          pulleys.BaseToMotor(std::max(0.0, base_N - t.pulley_coulomb_N), -1), z);
}

// All tendons count equally, and the straight-robot prior has negligible weight.
void Estimator::BendingWithAllTaut(const TendonVector& tension_base_N,
                                   const TendonVector& variance_m2) noexcept {
  const BendingMatrix one = BendingMatrix::Identity(bending_rad_.size(), bending_rad_.size());
  const BendingVector expected_rad =
      pulls_every_way_ ? BendingVector(-bending_rad_) : Settling(tension_base_N);
  EstimateBending(weight_, variance_m2,
                  {expected_rad, one * std::sqrt(straight_rad2_), one * (kPriorCount_m2 / straight_rad2_)});
}

// Tendons are weighted by their variance, against the prediction.
void Estimator::BendingWithSlack(const TendonVector& tension_base_N, TendonVector& variance_m2) noexcept {
  // Second-order effect of the unknown shape on the tendon paths.
  double unknown_m2 = 0;
  for (int k = 0; k < body_.sections(); ++k) {
    const double bent_m =
        curvature_mprad2_[static_cast<std::size_t>(k)] * covariance_rad2_.diagonal().segment<2>(2 * k).sum();
    unknown_m2 += bent_m * bent_m / 2;
  }
  const int m = static_cast<int>(tendons_.size());
  TendonVector counts(m);
  for (int j = 0; j < m; ++j) {
    const Tendon& t = tendons_[j];
    variance_m2[j] += unknown_m2;
    const double blind_m2 = t.range_variance_m2 * (1 - t.taut) * (1 - t.taut);
    counts[j] =
        kPriorCount_m2 * weight_[j] / (weight_[j] * (variance_m2[j] + kNoArc_m * kNoArc_m) + blind_m2);
    if (weight_[j] > 0) variance_m2[j] += blind_m2 / weight_[j];
  }
  const BendingMatrix one = BendingMatrix::Identity(bending_rad_.size(), bending_rad_.size());
  const double kept2 = kept_ * kept_;
  const auto factor = BendingMatrix(kept2 * covariance_rad2_ + (1 - kept2) * straight_rad2_ * one).llt();
  EstimateBending(counts, variance_m2,
                  {Settling(tension_base_N), factor.matrixL(), factor.solve(one * kPriorCount_m2)});
}

// Step of one cycle towards the shape that balances the tensions, with time constant kSettles_s.
BendingVector Estimator::Settling(const TendonVector& tension_base_N) noexcept {
  const auto k2 = bending_rad_.size();
  ForceMatrix force_per_tension(k2, tension_base_N.size());
  BendingVector force_Nm(k2);
  body_.SpreadBending(bending_rad_, q_);
  body_.StaticForce(q_, Eigen::Vector3d::Zero(), unit_force_Nm_);
  body_.ProjectForce(unit_force_Nm_, force_Nm);
  model::SectionForcePerTension(body_, bending_rad_, force_per_tension);
  force_Nm -= force_per_tension.lazyProduct(tension_base_N);
  BendingVector towards_rad = -force_Nm.cwiseQuotient(stiffness_Nm_);
  const double farthest_rad = towards_rad.lpNorm<Eigen::Infinity>();
  if (!std::isfinite(farthest_rad)) return BendingVector::Zero(k2);
  if (farthest_rad > max_bending_rad_) towards_rad *= max_bending_rad_ / farthest_rad;
  return (1 - kept_) * towards_rad;
}

// Least squares of the measured shortening against that of the arc, and of the bending against its
// prediction. The Jacobian by (us, vs) is the transpose of the force per tension (virtual work).
void Estimator::EstimateBending(const TendonVector& counts, const TendonVector& variance_m2,
                                const Expected& expected) noexcept {
  const int k2 = 2 * body_.sections();
  const int m = static_cast<int>(tendons_.size());
  ForceMatrix force_per_tension(k2, m);
  TendonVector modelled_m(m);
  // One Gauss-Newton step from the last estimate leaves less than an encoder step: at 8 rad/s a cycle moves
  // the shape by 0.008 rad, over which the shortening is practically linear.
  model::SectionForcePerTension(body_, bending_rad_, force_per_tension);
  body_.SpreadBending(bending_rad_, q_);
  body_.TendonShortening(q_, modelled_m);
  const ForceMatrix weighted = force_per_tension * counts.asDiagonal();
  BendingMatrix normal = weighted * force_per_tension.transpose();
  normal += expected.count;
  const auto factor = normal.ldlt();
  const ForceMatrix bending_per_shortening = factor.solve(weighted);
  const BendingMatrix bending_per_expected = factor.solve(expected.count);
  BendingVector best = bending_rad_ + bending_per_shortening * (shortening_m_ - modelled_m) +
                       bending_per_expected * expected.step_rad;
  const ForceMatrix scaled = bending_per_shortening * variance_m2.cwiseSqrt().asDiagonal();
  const BendingMatrix kept = bending_per_expected * expected.root_rad;
  covariance_rad2_ = scaled * scaled.transpose();
  covariance_rad2_ += kept * kept.transpose();
  if (!best.allFinite()) return;
  // Beyond the robot's range the measurement is wrong; keep the direction, bound the size.
  for (int k = 0; k < body_.sections(); ++k) {
    const double bend = best.segment<2>(2 * k).norm();
    if (bend > 1.5 * max_bending_rad_) best.segment<2>(2 * k) *= 1.5 * max_bending_rad_ / bend;
  }
  bending_rad_ = best;
}

void Estimator::Archive(StateArchive& a) noexcept {
  for (Tendon& t : tendons_) {
    a.Value(t.zero_counts);
    a.Value(t.taut);
    a.Operators(t.presliding);
  }
  if (!pulls_every_way_) {
    a.Vector(pretension_rad_, {2 * body_.sections()});
    for (TendonVector* v : {&pretension_m_, &tension_base_N_, &stretch_m_}) a.Vector(*v, {body_.tendons()});
  }
  a.Vector(bending_rad_, {2 * body_.sections()});
  for (int i = 0; i < bending_rad_.size(); ++i) {
    BendingVector column = covariance_rad2_.col(i);
    a.Vector(column, {2 * body_.sections()});
    covariance_rad2_.col(i) = column;
  }
}

}  // namespace tendril::control
