// Tensions under which the true equilibrium of all units, gravity and straight tendons included, has the
// section ends where the arcs of the reference have them: one or a few Newton steps a cycle from the last
// cycle's shape. Knows nothing of transmissions and motors.
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
/// and least sum (T - T_min)^2. The two rows of W_k span the plane in which the section's own bending moves
/// its end: a section with two bending freedoms cannot do more, and what is left over stands at right angles
/// to them, so the end is the nearest that bending reaches; of a section whose tendons lie on a line, W_k is
/// the one way in which they move its end. dq and ddq are the reference's, shared equally by a section's
/// units, m_k a bending moment along section k that the balance lacks.
class EquilibriumLaw {
 public:
  /// `body` outlives this object. Allocates all it needs.
  EquilibriumLaw(const model::Body& body, const LimitParameters& limits);

  /// One cycle. `least_N` is the least tension now, at least the robot's own, `most_N` each tendon's
  /// greatest, at most the robot's own; the least counts where they cross. `tip_shift_W_m` moves the goal of
  /// the last section's end, `lacking_Nm` is m_k. The first call, and each after one that failed, starts from
  /// the arc and `arc_tension_N`. kOk, kLimitedTensionMax or, where tendons do not pull every way,
  /// kLimitedTensionMin, for they would have to push: q() and tension_N() are the answer.
  /// kEquilibriumNotFound: no stable shape within the bounded iterations, the caller uses its own.
  Status Solve(const BendingReference& reference, const TendonVector& arc_tension_N, double least_N,
               const TendonVector& most_N, const Eigen::Vector3d& tip_shift_W_m,
               const BendingVector& lacking_Nm) noexcept;
  /// Instead, while tensions are commanded: the resting shape that they make, from the last one. False where
  /// there is none that is stable near it; the shape stays.
  bool Follow(const TendonVector& tension_N, const BendingVector& lacking_Nm) noexcept;

  const UnitVector& q() const noexcept { return q_; }
  const TendonVector& tension_N() const noexcept { return tension_N_; }
  /// Unit vectors that span the plane in which the last section moves the tip, at the last Solve's shape; of
  /// tendons that pull along a line only, the second is zero.
  const Eigen::Vector3d& tip_u() const noexcept { return tip_u_; }
  const Eigen::Vector3d& tip_v() const noexcept { return tip_v_; }
  /// 2K x 2K: by how much the sections bend for a moment along each, tensions as they are, at the last
  /// Solve's shape [rad/(N·m)].
  BendingMatrix SectionCompliance() noexcept;
  /// Newton steps of the last Solve.
  int iterations() const noexcept { return iterations_; }

  /// Forgets the shape: the next call starts from the arc.
  void Reset() noexcept { warm_ = false; }
  void Remember(StateArchive& archive) noexcept;

 private:
  bool Step(double& size_rad) noexcept;
  void Add(const BendingVector& section_Nm, UnitVector& unit_Nm) const noexcept;
  void Goals() noexcept;
  void KeepPulledWays() noexcept;

  const model::Body& body_;
  double robot_min_tension_N_, max_tension_N_;
  std::vector<bool> on_line_;  // a section's own tendons
  model::Body::Workspace workspace_;
  model::TensionAllocator allocator_;
  bool warm_ = false;
  UnitVector q_;
  TendonVector tension_N_;

  // Of one call only.
  double min_tension_N_;
  TendonVector most_tension_N_;
  int iterations_ = 0;
  Status status_ = Status::kOk;
  UnitVector arc_q_, dq_, ddq_, residual_, pulled_;
  BendingVector lacking_Nm_;
  std::vector<model::Pose> pose_;
  std::vector<Eigen::Vector3d> goal_W_m_;  // a section
  Eigen::Vector3d tip_u_{1, 0, 0}, tip_v_{0, 1, 0};
  Eigen::MatrixXd stiffness_, lengths_, solved_, tip_jacobian_, goal_rows_, goal_per_tension_;
  BendingVector goal_gap_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
};

}  // namespace tendril::control
