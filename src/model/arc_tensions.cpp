#include "tendril/model/arc_tensions.h"

#include <utility>

namespace tendril::model {

ArcTensions::ArcTensions(const Body& body, TendonPairs pairs)
    : body_(body),
      workspace_(body),
      allocator_(body.tendons(), 2 * body.sections(), std::move(pairs)),
      q_(UnitVector::Zero(body.dof())),
      dq_(q_),
      ddq_(q_),
      unit_force_Nm_(q_),
      still_(BendingVector::Zero(2 * body.sections())),
      force_Nm_(still_),
      force_per_tension_(2 * body.sections(), body.tendons()) {}

TensionAllocator::Result ArcTensions::Hold(const BendingVector& us_vs, double least_N,
                                           double most_N) noexcept {
  return Move(us_vs, still_, still_, least_N, most_N);
}

TensionAllocator::Result ArcTensions::Move(const BendingVector& us_vs, const BendingVector& rate_radps,
                                           const BendingVector& acceleration_radps2, double least_N,
                                           double most_N) noexcept {
  body_.SpreadBending(us_vs, q_);
  body_.SpreadBending(rate_radps, dq_);
  body_.SpreadBending(acceleration_radps2, ddq_);
  body_.InverseDynamics(q_, dq_, ddq_, unit_force_Nm_, workspace_);
  body_.ProjectForce(unit_force_Nm_, force_Nm_);
  SectionForcePerTension(body_, us_vs, force_per_tension_);
  allocator_.Bend(body_, q_);
  return allocator_.Allocate(force_per_tension_, force_Nm_, least_N, most_N);
}

}  // namespace tendril::model
