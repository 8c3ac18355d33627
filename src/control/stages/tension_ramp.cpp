#include "tendril/control/tension_ramp.h"

#include <algorithm>

#include "tendril/control/state_archive.h"
#include "tendril/model/inverse.h"

namespace tendril::control {

TensionRamp::TensionRamp(const model::Body& body, double rate_radps, double gather_s, double period_s)
    : step_rad_(rate_radps * period_s),
      corner_radps_(4 / gather_s),
      period_s_(period_s),
      bend_per_tension_(2 * body.sections(), body.tendons()),
      ramp_N_(TendonVector::Zero(body.tendons())),
      tension_N_(ramp_N_),
      rate_Nps_(ramp_N_) {
  model::SectionForcePerTension(body, BendingVector::Zero(2 * body.sections()), bend_per_tension_);
  for (int k = 0; k < body.sections(); ++k) {
    double softness = 0;
    for (int i = body.first_unit(k); i < body.end_unit(k); ++i) softness += 1 / body.unit_stiffness_Nm(i);
    bend_per_tension_.middleRows<2>(2 * k) *= softness;
  }
}

void TensionRamp::Start(const TendonVector& tension_N) noexcept {
  ramp_N_ = tension_N_ = tension_N;
  rate_Nps_.setZero();
}

const TendonVector& TensionRamp::Step(const TendonVector& target_N, double step_N) noexcept {
  TendonVector step = (target_N - ramp_N_).cwiseMax(-step_N).cwiseMin(step_N);
  const BendingVector bend_rad = bend_per_tension_.lazyProduct(step);
  double fastest_rad = 0;
  for (Eigen::Index k = 0; k < bend_rad.size(); k += 2)
    fastest_rad = std::max(fastest_rad, bend_rad.segment<2>(k).norm());
  if (fastest_rad > step_rad_) step *= step_rad_ / fastest_rad;
  ramp_N_ += step;
  const double w = corner_radps_;
  rate_Nps_ += period_s_ * (w * w * (ramp_N_ - tension_N_) - 2 * w * rate_Nps_);
  tension_N_ += period_s_ * rate_Nps_;
  return tension_N_;
}

void TensionRamp::Archive(StateArchive& a) noexcept {
  for (TendonVector* v : {&ramp_N_, &tension_N_, &rate_Nps_}) a.Vector(*v, {v->size()});
}

}  // namespace tendril::control
