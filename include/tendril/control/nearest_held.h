// Of the arcs that tensions hold at rest the nearest to one that is asked for: for robots whose tendons do
// not pull every way, and so hold a line or a wedge of bends only. Safe in the tick.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "tendril/core/limits.h"
#include "tendril/core/status.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::control {

class NearestHeld {
 public:
  /// `body` outlives this object; tensions at the base.
  NearestHeld(const model::Body& body, double min_tension_N, double max_tension_N);

  /// With b(T) the arcs in equilibrium at tensions T, brings `bending_rad` to that of the least |b(T) -
  /// asked| within the bounds; of a section whose tendons lie on a line, along that line: what it sags across
  /// is not bought with pulling both ways at once. kOk: held as asked for, but for kSame_rad;
  /// kLimitedTensionMax: more tension would come nearer; kLimitedDirection: nothing would. What no stable arc
  /// is found for stays, with kOk.
  Status Bring(BendingVector& bending_rad) noexcept;

 private:
  // A thousandth of an arc's length at its tip, which is its bend times half its length.
  static constexpr double kSame_rad = 2e-3;

  bool Linearise(const BendingVector& bending_rad, const TendonVector& tension_N) noexcept;

  const model::Body& body_;
  model::TensionAllocator allocator_;
  double min_tension_N_, max_tension_N_;
  Eigen::MatrixXd spread_, unit_stiffness_, force_per_tension_, bend_per_tension_, pulled_per_tension_;
  BendingMatrix pulled_;  // 2K x 2K, takes out of a bend what is across a line of tendons
  UnitVector q_, unit_force_Nm_;
  BendingVector force_Nm_;      // that holds the arc
  BendingMatrix stiffness_Nm_;  // 2K x 2K, of arcs at given tensions
  Eigen::LLT<BendingMatrix> factor_;
};

}  // namespace tendril::control
