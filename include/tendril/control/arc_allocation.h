// A cycle's tensions for the reference arcs: where a law starts from, or falls back to. Keeps nothing from
// one call to the next. Safe in the tick.
#pragma once

#include <Eigen/Core>
#include <utility>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"
#include "tendril/model/arc_tensions.h"
#include "tendril/model/body.h"

namespace tendril::control {

class ArcAllocation {
 public:
  /// `body` outlives this object.
  explicit ArcAllocation(const model::Body& body, model::TendonPairs pairs = {})
      : body_(body), arcs_(body, std::move(pairs)) {}

  /// From here on friction adds this to both tensions of pairs.
  void AddFriction(const TendonVector& offset_N) noexcept { arcs_.AddFriction(offset_N); }
  /// From `output.reference`: sets reference_tip_W_m, displacement_desired_m, generalised_force_Nm and
  /// tension_desired_base_N. Returns the bound that tensions reached; kOk for the minimum, which is normal
  /// where the backbone alone returns the robot.
  Status Step(const LimitParameters& limits, CycleOutput& output) noexcept;

  /// Force on the sections per tension, of the last call.
  const Eigen::MatrixXd& force_per_tension() const noexcept { return arcs_.force_per_tension(); }

 private:
  const model::Body& body_;
  model::ArcTensions arcs_;
};

}  // namespace tendril::control
