#include "tendril/control/estimator.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "state_archive.h"
#include "tendril/model/inverse.h"

namespace tendril::control {
namespace {

using SectionMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, 2 * kMaxSections>;
using ForceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, kMaxTendons>;

// Gauss-Newton from the last cycle's estimate: the shape moves so little in a cycle that two steps reach
// round-off.
constexpr int kGaussNewtonSteps = 2;

}  // namespace

Estimator::Estimator(const RobotParameters& robot, const model::Body& body,
                     const std::vector<std::shared_ptr<const model::CapstanTable>>& tables)
    : body_(body),
      tables_(tables),
      min_tension_N_(robot.limits.min_tension_N),
      max_bending_rad_(robot.limits.max_bending_rad),
      bending_rad_(BendingVector::Zero(2 * body.sections())),
      q_(UnitVector::Zero(body.dof())) {
  for (const auto& t : robot.actuation->tendons) {
    const double per_mV = t.load_cell.gain_VpN > 0 ? 1e-3 / t.load_cell.gain_VpN : 0;
    tendons_.push_back({2 * std::numbers::pi / t.drive.encoder_counts_per_turn * t.SpoolTravelPerMotorRad(),
                        t.drive.rated_torque_Nm, t.motor.torque_scale, per_mV, t.load_cell.offset_N,
                        t.tendon.stiffness_Npm, t.SpoolTravelPerMotorRad(), t.gear.efficiency,
                        t.motor.coulomb_friction_Nm, t.transmission.coulomb_N, t.load_cell.place, 0,
                        model::PulleyPresliding(t.transmission.presliding_m)});
  }
}

void Estimator::ZeroDisplacement(const CycleInput& input) noexcept {
  for (std::size_t j = 0; j < tendons_.size(); ++j) {
    tendons_[j].zero_counts = input.drive[j].position_counts;
    tendons_[j].presliding.Reset(0);
  }
  bending_rad_.setZero();
}

void Estimator::Step(const CycleInput& input, CycleOutput& output) noexcept {
  const int m = static_cast<int>(tendons_.size());
  TendonVector shortening_m(m);
  for (int j = 0; j < m; ++j) {
    Tendon& t = tendons_[j];
    const DriveFeedback& d = input.drive[j];
    // Unsigned difference: the drive's position counter wraps.
    const auto counts = static_cast<std::int32_t>(static_cast<std::uint32_t>(d.position_counts) -
                                                  static_cast<std::uint32_t>(t.zero_counts));
    const double pull_m = counts * t.travel_per_count_m;
    const double z = t.presliding.Commit(pull_m);
    const double torque_Nm = d.torque_permille * 1e-3 * t.rated_torque_Nm;
    const double cell_N = d.analog_mV * t.newton_per_mV - t.cell_offset_N;
    const double bearing_N = t.pulley_coulomb_N * z;  // lost in the pulleys whatever the load

    double motor_N = 0, base_N = 0;
    switch (t.place) {
      case LoadCellPlace::kMotorSide:
        motor_N = cell_N;
        base_N = std::max(0.0, tables_[j]->MotorToBase(std::max(motor_N, 0.0), z) - bearing_N);
        break;
      case LoadCellPlace::kRobotSide:
        base_N = cell_N;
        motor_N = tables_[j]->BaseToMotor(std::max(base_N + bearing_N, 0.0), z);
        break;
      case LoadCellPlace::kNone:
        motor_N = std::max(
            0.0, (t.torque_scale * torque_Nm - t.coulomb_Nm * z) / t.travel_m * std::pow(t.efficiency, z));
        base_N = std::max(0.0, tables_[j]->MotorToBase(motor_N, z) - bearing_N);
        break;
    }
    output.displacement_m[j] = pull_m;
    output.tension_measured_N[j] = t.place == LoadCellPlace::kNone ? motor_N : cell_N;
    output.tension_base_estimate_N[j] = base_N;
    output.torque_measured_Nm[j] = torque_Nm;
    shortening_m[j] = pull_m - (motor_N - min_tension_N_) / t.stiffness_Npm;
  }
  EstimateBending(shortening_m);
  body_.SpreadBending(bending_rad_, q_);
  const model::Pose tip = body_.TipPose(q_);
  output.bending_estimate_rad = bending_rad_;
  output.tip_estimate_W_m = tip.p_WA;
  output.orientation_estimate_WT = Eigen::Quaterniond(tip.R_WA);
}

// Least squares of the measured shortening against that of the arc shape. Its Jacobian by (us, vs) is the
// transpose of the force per tension (virtual work).
void Estimator::EstimateBending(const TendonVector& shortening_m) noexcept {
  const int k2 = 2 * body_.sections();
  const int m = static_cast<int>(tendons_.size());
  ForceMatrix force_per_tension(k2, m);
  TendonVector modelled_m(m);
  BendingVector best = bending_rad_;
  for (int step = 0; step < kGaussNewtonSteps; ++step) {
    model::SectionForcePerTension(body_, best, force_per_tension);
    body_.SpreadBending(best, q_);
    body_.TendonShortening(q_, modelled_m);
    const SectionMatrix normal = force_per_tension * force_per_tension.transpose();
    best += normal.ldlt().solve(force_per_tension * (shortening_m - modelled_m));
  }
  if (!best.allFinite()) return;
  // Beyond what the robot may ever do the measurement is wrong; keep the direction, bound the size.
  for (int k = 0; k < body_.sections(); ++k) {
    const double bend = best.segment<2>(2 * k).norm();
    if (bend > 1.5 * max_bending_rad_) best.segment<2>(2 * k) *= 1.5 * max_bending_rad_ / bend;
  }
  bending_rad_ = best;
}

void Estimator::Remember(StateArchive& a) noexcept {
  for (Tendon& t : tendons_) {
    a.Value(t.zero_counts);
    a.Operators(t.presliding);
  }
  a.Vector(bending_rad_, {2 * body_.sections()});
}

}  // namespace tendril::control
