// Tensions for which the static equilibrium of all units, with gravity and straight tendons, puts the section
// ends where the reference arcs have them: a few Newton steps per cycle from the last cycle's shape. Knows
// nothing of transmissions and motors.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::control {

class StateArchive;

/// Unknown unit angles q and tensions T with
///   balance(q, dq, ddq) + m_k = -sum_j T_j dL_j/dq                (every unit's equation of motion),
///   W_k(q) (p_k(q) - p_k(arc)) = 0 for the end p_k of each section,   T_min <= T <= T_max,
/// that minimise sum (T - T_min)^2. The two rows of W_k span the plane in which the section's own bending
/// moves its end: a section has two bending freedoms, the remaining error is normal to that plane, and so the
/// end is the nearest point that bending reaches. For a section whose tendons lie on a line, W_k is the
/// single direction in which they move its end. dq and ddq are the reference's, shared equally by a section's
/// units, m_k a bending moment along section k that the balance lacks.
class EquilibriumSolver {
 public:
  /// `body` outlives this object. The constructor allocates all memory.
  EquilibriumSolver(const model::Body& body, const LimitParameters& limits, model::TendonPairs pairs = {});

  /// From here on friction adds this to both tensions of pairs.
  void AddFriction(const TendonVector& offset_N) noexcept { allocator_.AddFriction(offset_N); }

  /// One cycle. `least_N` is the present minimum tension, at least the robot's own; `most_N` is each tendon's
  /// maximum, at most the robot's own; the minimum wins where they cross. `tip_shift_W_m` moves the goal of
  /// the last section's end, `lacking_Nm` is m_k. The first call, and each call after a failed one, starts
  /// from the arc and `arc_tension_N`. q() and tension_N() are the solution for kOk, kLimitedTensionMax and,
  /// where tendons do not pull in every direction and would have to push, kLimitedTensionMin.
  /// kEquilibriumNotFound: no stable shape within the iteration limit; the caller uses its own tensions.
  Status Solve(const BendingReference& reference, const TendonVector& arc_tension_N, double least_N,
               const TendonVector& most_N, const Eigen::Vector3d& tip_shift_W_m,
               const BendingVector& lacking_Nm) noexcept;
  /// For commanded tensions: the equilibrium shape that they produce, searched from the last one. False, with
  /// the shape unchanged, where no stable shape is found.
  bool Follow(const TendonVector& tension_N, const BendingVector& lacking_Nm) noexcept;

  const UnitVector& q() const noexcept { return q_; }
  const TendonVector& tension_N() const noexcept { return tension_N_; }
  /// Unit vectors spanning the plane in which the last section moves the tip, at the last Solve's shape.
  /// Where tendons pull along a line only, the second vector is zero.
  const Eigen::Vector3d& tip_u() const noexcept { return tip_u_; }
  const Eigen::Vector3d& tip_v() const noexcept { return tip_v_; }
  /// Bending of the sections per moment along each (2K x 2K) at constant tensions, at the last Solve's shape
  /// [rad/(N·m)].
  BendingMatrix SectionCompliance() noexcept;
  /// Newton steps taken by the last Solve.
  int iterations() const noexcept { return iterations_; }

  /// Discards the shape; the next call starts from the arc.
  void Reset() noexcept { warm_ = false; }
  void Archive(StateArchive& archive) noexcept;

 private:
  bool Step(double& size_rad) noexcept;
  void Add(const BendingVector& section_Nm, UnitVector& unit_Nm) const noexcept;
  void Goals() noexcept;
  void KeepPulledWays() noexcept;

  const model::Body& body_;
  double robot_min_tension_N_, max_tension_N_;
  std::vector<bool> on_line_;  // per section: its own tendons lie on a line
  model::Body::Workspace workspace_;
  model::TensionAllocator allocator_;
  bool warm_ = false;
  UnitVector q_;
  TendonVector tension_N_;

  // Valid within one call only.
  double min_tension_N_;
  TendonVector most_tension_N_;
  int iterations_ = 0;
  Status status_ = Status::kOk;
  UnitVector arc_q_, dq_, ddq_, residual_, pulled_;
  BendingVector lacking_Nm_;
  std::vector<model::Pose> pose_;
  std::vector<Eigen::Vector3d> goal_W_m_;  // per section
  Eigen::Vector3d tip_u_{1, 0, 0}, tip_v_{0, 1, 0};
  Eigen::MatrixXd stiffness_, lengths_, solved_, tip_jacobian_, goal_rows_, goal_per_tension_;
  BendingVector goal_gap_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
};

}  // namespace tendril::control
