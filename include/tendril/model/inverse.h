// From reference motion to tensions: inverse kinematics of constant-curvature sections and the allocation of
// tendon tensions. Everything here is safe in the tick: noexcept, no allocation after construction, bounded
// iterations.
#pragma once

#include <Eigen/Core>

#include "tendril/core/limits.h"
#include "tendril/core/status.h"
#include "tendril/model/body.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::model {

struct IkSolution {
  BendingVector us_vs;               // 2K
  Eigen::Vector3d tip_W_m{0, 0, 0};  // constant-curvature tip of the solution
  double distance_m = 0;             // from the target to that tip
  Status status = Status::kOk;  // kTargetUnreachable: nearest reachable point; kSolverFallback: stopped early
  int iterations = 0;
};

/// Tip position -> (us, vs) per section under constant curvature, |(us, vs)| <= max_bending_rad per section.
/// One section: its tip can only lie on a surface of revolution about z. A target on it has the closed form
/// (paper eq. 5 with atan2); for any other target the nearest point of the surface is taken. On the z axis
/// the bending plane is free: the seed's is kept. More sections: damped Newton on the distance from the seed,
/// so that the solution stays near it; other start shapes are tried when it does not converge to the target.
/// Targets farther than 1 nm (plus 1e-9 of the robot's length) from the reached tip give kTargetUnreachable
/// with the distance. The body must outlive this object.
class InverseKinematics {
 public:
  /// Throws std::invalid_argument unless 0 < max_bending_rad <= 2 pi.
  InverseKinematics(const Body& body, double max_bending_rad);

  IkSolution Solve(const Eigen::Vector3d& target_W_m, const BendingVector& seed) const noexcept;

  /// Constant-curvature tip of (us, vs).
  Eigen::Vector3d Tip(const BendingVector& us_vs) const noexcept;

 private:
  const Body& body_;
  double max_bending_rad_;
};

/// Tensions for a required generalised force on the sections: among all T with T_min <= T <= T_max that
/// produce it, the one with least sum (T - T_min)^2; unique, hence continuous in the force. Where none
/// exists, the admissible T whose force is nearest, and among these the one of least sum. Of an
/// antagonistic pair the unknown is what its motor pulls: the sum counts what that changes, and neither
/// tendon has less than the robot's minimum tension, whatever T_min. Equal input, shape and friction, equal
/// bits.
class TensionAllocator {
 public:
  /// Throws std::invalid_argument outside 1..kMaxTendons and 1..2 kMaxSections.
  /// The pairs are at the straight robot's tensions until Bend says otherwise.
  TensionAllocator(int tendons, int forces, TendonPairs pairs = {});

  struct Result {
    TendonVector tension_N;
    double residual_Nm = 0;       // norm of the force not produced
    Status status = Status::kOk;  // kLimitedTensionMax: force not reachable; kSolverFallback: not finite
    /// The bound that prevents the force, or a nearer one: kLimitedTensionMax, or kLimitedTensionMin where
    /// tendons would have to push. kOk when the force is reached or no tension could produce the rest. Equal
    /// to `status` where the tendons span every force.
    Status bound = Status::kOk;
    int iterations = 0;
  };

  /// force = jacobian * T; jacobian is (2K x M), for example -dL/d(us, vs) transposed.
  Result Allocate(const Eigen::Ref<const Eigen::MatrixXd>& jacobian, ConstVectorRef force_Nm,
                  double min_tension_N, double max_tension_N) const noexcept;
  /// The same with a maximum tension per tendon.
  Result Allocate(const Eigen::Ref<const Eigen::MatrixXd>& jacobian, ConstVectorRef force_Nm,
                  double min_tension_N, const TendonVector& max_tension_N) const noexcept;

  /// From here on the body has this shape, which changes the tensions of pairs.
  void Bend(const Body& body, ConstVectorRef q) noexcept;
  /// From here on friction adds this to both tensions of pairs.
  void AddFriction(const TendonVector& offset_N) noexcept;
  /// Tensions that no motor pulls: `min_tension_N`, of pairs their own.
  TendonVector Unpulled_N(double min_tension_N) const noexcept;

 private:
  Result AllocatePairs(const Eigen::Ref<const Eigen::MatrixXd>& jacobian, ConstVectorRef force_Nm,
                       double min_tension_N, const TendonVector& max_tension_N) const noexcept;

  int tendons_, forces_;
  TendonPairs pairs_;
  TendonVector shortening_m_, offset_N_;
};

/// 2K x M: generalised force on the sections' arc motion per unit tension, at (us, vs).
void SectionForcePerTension(const Body& body, const BendingVector& us_vs, MatrixRef jacobian) noexcept;

}  // namespace tendril::model
