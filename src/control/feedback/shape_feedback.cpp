#include "tendril/control/shape_feedback.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <complex>

#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// Above this bend an error is attributed to effects that grow with the bend.
constexpr double kBent_rad = 0.3;
constexpr double kRest_radps = 1e-4;
constexpr double kLeastShown = 1e-9;
constexpr double kShapeErrorFilter_s = 0.05;

using Complex = std::complex<double>;
Complex At(const BendingVector& v, int section) { return {v[2 * section], v[2 * section + 1]}; }
/// Stores the value, limited to `most`; false when it was limited.
bool Put(BendingVector& v, int section, Complex value, double most) {
  const double size = std::abs(value);
  if (size > most) value *= most / size;
  v.segment<2>(2 * section) << value.real(), value.imag();
  return size <= most;
}

}  // namespace

ShapeFeedback::ShapeFeedback(const model::Body& body, double time_constant_s, double friction_Nm,
                             double period_s)
    : time_constant_s_(time_constant_s),
      friction_Nm_(friction_Nm),
      period_s_(period_s),
      stiffness_Nm_(2 * body.sections()) {
  for (int k = 0; k < body.sections(); ++k) {
    double softness = 0;
    for (int i = body.first_unit(k); i < body.end_unit(k); ++i) softness += 1 / body.unit_stiffness_Nm(i);
    stiffness_Nm_.segment<2>(2 * k).setConstant(1 / softness);
  }
  reference_m_.fill(TendonVector::Zero(body.tendons()));
  Reset();
}

void ShapeFeedback::Reset() noexcept {
  const BendingVector none = BendingVector::Zero(stiffness_Nm_.size());
  last_rad_ = error_rad_ = share_ = offset_rad_ = moment_Nm_ = onset_Nm_ = none;
  for (TendonVector& w : reference_m_) w.setZero();
  way_Nm_ = largest_Nm_ = 0;
  asleep_ = false;
}

Status ShapeFeedback::Step(const BendingVector& bending_rad, const TendonVector& reference_m,
                           const TendonVector& measured_m, const TendonVector& weight,
                           const Eigen::Ref<const Eigen::MatrixXd>& force_per_tension,
                           const BendingMatrix& compliance, double hold_Nm, bool acts,
                           bool at_limit) noexcept {
  const TendonVector missing_m = reference_m_[0] - measured_m;
  for (int i = 0; i + 1 < kDelayCycles; ++i) reference_m_[i] = reference_m_[i + 1];
  reference_m_[kDelayCycles - 1] = reference_m;
  const bool rests = (bending_rad - last_rad_).norm() < kRest_radps * period_s_;
  last_rad_ = bending_rad;

  // Force per tension is shortening per bend, transposed (virtual work).
  BendingMatrix normal = force_per_tension * weight.asDiagonal() * force_per_tension.transpose();
  // Regularised: directions that no taut tendon measures have no error.
  normal.diagonal().array() += kLeastShown * force_per_tension.squaredNorm();
  const BendingVector error_rad = normal.ldlt().solve(
      BendingVector(force_per_tension.lazyProduct(TendonVector(weight.cwiseProduct(missing_m)))));
  if (!acts || !error_rad.allFinite()) {
    error_rad_.setZero();
  } else {
    error_rad_ += (1 - std::exp(-period_s_ / kShapeErrorFilter_s)) * (error_rad - error_rad_);
  }
  Status status = Status::kOk;
  const BendingVector bends_Nm = compliance.ldlt().solve(error_rad_);
  if (!bends_Nm.allFinite()) acts = false;
  if (at_limit) {
    share_ *= 1 - period_s_ / time_constant_s_;
    offset_rad_ *= 1 - period_s_ / time_constant_s_;
    acts = false;
  }
  const double missing_Nm = bends_Nm.norm();
  if (!rests) {
    onset_Nm_ = moment_Nm_;
    way_Nm_ = largest_Nm_ = 0;
    asleep_ = false;
  } else if (acts) {
    largest_Nm_ = std::max(largest_Nm_, missing_Nm);
    const bool spent = way_Nm_ > kRestWay * largest_Nm_, slept = asleep_;
    const double band_Nm = spent ? std::max(friction_Nm_, largest_Nm_) : friction_Nm_;
    asleep_ = missing_Nm <= (asleep_ ? kWake : 1) * band_Nm;
    if (spent && slept && !asleep_) way_Nm_ = 0;
    const BendingVector pushed_Nm = moment_Nm_ - onset_Nm_;
    if (pushed_Nm.norm() > hold_Nm && pushed_Nm.dot(bends_Nm) > 0) acts = false;
    if (acts && !asleep_) way_Nm_ += missing_Nm * period_s_ / time_constant_s_;
  }
  for (int k = 0; k < static_cast<int>(stiffness_Nm_.size()) / 2; ++k) {
    const Complex b = At(bending_rad, k);
    if (acts && !asleep_) {
      const Complex step = At(bends_Nm, k) / stiffness_Nm_[2 * k] * (period_s_ / time_constant_s_) /
                           (std::norm(b) + kBent_rad * kBent_rad);
      const bool free = Put(share_, k, At(share_, k) + step * std::conj(b), kMaxShare);
      if (!Put(offset_rad_, k, At(offset_rad_, k) + step * (kBent_rad * kBent_rad), kMaxShare) || !free)
        status = Status::kLimitedShapeCorrection;
    }
    Put(moment_Nm_, k, stiffness_Nm_[2 * k] * (At(share_, k) * b + At(offset_rad_, k)), HUGE_VAL);
  }
  return status;
}

void ShapeFeedback::Archive(StateArchive& a) noexcept {
  for (TendonVector& w : reference_m_) a.Vector(w, {w.size()});
  for (BendingVector* v : {&last_rad_, &error_rad_, &share_, &offset_rad_, &moment_Nm_, &onset_Nm_})
    a.Vector(*v, {v->size()});
  a.Value(way_Nm_);
  a.Value(largest_Nm_);
  a.Value(asleep_);
}

}  // namespace tendril::control
