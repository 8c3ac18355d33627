// From bend to tensions: inverse dynamics of arcs by Kane's equations, then the least tensions that give the
// force. Keeps nothing from one call to the next. Safe in the tick.
#pragma once

#include <Eigen/Core>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::control {

class ArcAllocation {
 public:
  using ForceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxSections, kMaxTendons>;

  /// `body` outlives this object.
  explicit ArcAllocation(const model::Body& body);

  /// Base tensions between the bounds that move the arcs so, or that come nearest; see TensionAllocator.
  model::TensionAllocator::Result Allocate(const BendingReference& arcs, double min_tension_N,
                                           double max_tension_N) noexcept;
  /// The same for a cycle's reference: sets reference_tip_W_m, displacement_desired_m, generalised_force_Nm
  /// and tension_desired_base_N. Returns the bound that tensions reached; kOk for the minimum, which is
  /// normal where the backbone alone returns the robot.
  Status Step(const LimitParameters& limits, CycleOutput& output) noexcept;

  // Of the last call: unit angles of the arcs, force on the sections, and their force per tension.
  const UnitVector& q() const noexcept { return q_; }
  const BendingVector& force_Nm() const noexcept { return force_Nm_; }
  const ForceMatrix& force_per_tension() const noexcept { return force_per_tension_; }

 private:
  const model::Body& body_;
  model::Body::Workspace workspace_;
  model::TensionAllocator allocator_;
  UnitVector q_, dq_, ddq_, unit_force_Nm_;
  BendingVector force_Nm_;
  ForceMatrix force_per_tension_;
};

}  // namespace tendril::control
