#include "tendril/control/arc_allocation.h"

namespace tendril::control {

ArcAllocation::ArcAllocation(const model::Body& body)
    : body_(body),
      workspace_(body),
      allocator_(body.tendons(), 2 * body.sections()),
      q_(UnitVector::Zero(body.dof())),
      dq_(q_),
      ddq_(q_),
      unit_force_Nm_(q_),
      force_Nm_(BendingVector::Zero(2 * body.sections())),
      force_per_tension_(2 * body.sections(), body.tendons()) {}

model::TensionAllocator::Result ArcAllocation::Allocate(const BendingReference& arcs, double min_tension_N,
                                                        double max_tension_N) noexcept {
  body_.SpreadBending(arcs.position_rad, q_);
  body_.SpreadBending(arcs.velocity_radps, dq_);
  body_.SpreadBending(arcs.acceleration_radps2, ddq_);
  body_.InverseDynamics(q_, dq_, ddq_, unit_force_Nm_, workspace_);
  body_.ProjectForce(unit_force_Nm_, force_Nm_);
  model::SectionForcePerTension(body_, arcs.position_rad, force_per_tension_);
  return allocator_.Allocate(force_per_tension_, force_Nm_, min_tension_N, max_tension_N);
}

Status ArcAllocation::Step(const LimitParameters& limits, CycleOutput& output) noexcept {
  const auto allocated = Allocate(output.reference, limits.min_tension_N, limits.max_tension_base_N);
  output.reference_tip_W_m = body_.TipPose(q_).p_WA;
  body_.TendonShortening(q_, output.displacement_desired_m);
  output.generalised_force_Nm = force_Nm_;
  output.tension_desired_base_N = allocated.tension_N;
  return allocated.bound == Status::kLimitedTensionMin ? Status::kOk : allocated.bound;
}

}  // namespace tendril::control
