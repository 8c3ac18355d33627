// The nearest holdable arc to a requested one, for robots whose tendons do not pull in every direction and so
// hold only a line or a wedge of bends. Safe in the tick.
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
  /// `body` outlives this object; tensions are those at the base.
  NearestHeld(const model::Body& body, double min_tension_N, double max_tension_N,
              model::TendonPairs pairs = {});

  /// With b(T) the arcs in equilibrium at tensions T, projects `bending_rad` onto the one with the least
  /// |b(T) - requested| within the bounds. For a section whose tendons lie on a line the distance is taken
  /// along that line, because co-contraction does not correct sag across it. kOk: holdable as requested,
  /// within kSame_rad; kLimitedTensionMax: more tension would come nearer; kLimitedDirection: nothing would.
  /// If no stable arc is found, `bending_rad` stays unchanged, with kOk.
  Status Project(BendingVector& bending_rad) noexcept;

 private:
  // A thousandth of an arc's length at its tip, which moves by the bend times half the length.
  static constexpr double kSame_rad = 2e-3;

  bool Linearise(const BendingVector& bending_rad, const TendonVector& tension_N) noexcept;

  const model::Body& body_;
  model::TensionAllocator allocator_;
  double min_tension_N_, max_tension_N_;
  Eigen::MatrixXd spread_, unit_stiffness_, force_per_tension_, bend_per_tension_, pulled_per_tension_;
  BendingMatrix pulled_;  // 2K x 2K, removes the part of a bend across a line of tendons
  UnitVector q_, unit_force_Nm_;
  BendingVector force_Nm_;      // required to hold the arc
  BendingMatrix stiffness_Nm_;  // 2K x 2K, of arcs at constant tensions
  Eigen::LLT<BendingMatrix> factor_;
};

}  // namespace tendril::control
