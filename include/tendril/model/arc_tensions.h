// Least tensions at the base for bends of constant curvature, at rest or in motion: Kane's equations along
// the arcs, and the allocation of what they ask for. Safe in the tick, like inverse.h.
#pragma once

#include <Eigen/Core>

#include "tendril/core/limits.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::model {

class ArcTensions {
 public:
  /// `body` must outlive this object.
  explicit ArcTensions(const Body& body, TendonPairs pairs = {});

  /// Tensions from `least_N` to `most_N` that hold (us, vs) at rest; without friction. Where there are none,
  /// those that come nearest, as TensionAllocator says.
  TensionAllocator::Result Hold(const BendingVector& us_vs, double least_N, double most_N) noexcept;
  /// The same while the arcs move at these rates [rad/s] and accelerations [rad/s^2].
  TensionAllocator::Result Move(const BendingVector& us_vs, const BendingVector& rate_radps,
                                const BendingVector& acceleration_radps2, double least_N,
                                double most_N) noexcept;

  /// From here on friction adds this to both tensions of pairs.
  void AddFriction(const TendonVector& offset_N) noexcept { allocator_.AddFriction(offset_N); }

  // Of the last call: unit angles of the arcs, force on the sections, and their force per tension.
  const UnitVector& q() const noexcept { return q_; }
  const BendingVector& force_Nm() const noexcept { return force_Nm_; }
  const Eigen::MatrixXd& force_per_tension() const noexcept { return force_per_tension_; }

 private:
  const Body& body_;
  Body::Workspace workspace_;
  TensionAllocator allocator_;
  UnitVector q_, dq_, ddq_, unit_force_Nm_;
  BendingVector still_, force_Nm_;
  Eigen::MatrixXd force_per_tension_;
};

}  // namespace tendril::model
