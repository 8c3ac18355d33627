// From wanted motion to tensions: inverse kinematics of constant-curvature sections and the allocation of tendon
// tensions. Everything here is safe in the tick: noexcept, no allocation after construction, bounded iterations.
#pragma once

#include <Eigen/Core>

#include "tendril/core/limits.h"
#include "tendril/core/status.h"
#include "tendril/model/body.h"

namespace tendril::model {

struct IkSolution {
  BendingVector us_vs;              // 2K
  Eigen::Vector3d tip_W_m{0, 0, 0}; // constant-curvature tip of the solution
  double distance_m = 0;            // from the target to that tip
  Status status = Status::kOk;      // kTargetUnreachable: nearest reachable point; kSolverFallback: stopped early
  int iterations = 0;
};

/// Tip position -> (us, vs) per section under constant curvature. One section: closed form (paper eq. 5 with atan2;
/// the target is reached when it lies on the section's surface, else the nearest point of that surface is taken).
/// More: damped least squares from the seed, bending within max_bending_rad per section.
class InverseKinematics {
 public:
  InverseKinematics(const Body& body, double max_bending_rad);

  IkSolution Solve(const Eigen::Vector3d& target_W_m, const BendingVector& seed) noexcept;

  /// Constant-curvature tip of (us, vs).
  Eigen::Vector3d Tip(const BendingVector& us_vs) const noexcept;

 private:
  const Body& body_;
  double max_bending_rad_;
};

/// Tensions for a wanted generalised force on the sections: among all T with T_min <= T <= T_max that produce it, the
/// one with least sum (T - T_min)^2; unique, hence continuous in the force. Where none exists, the admissible T whose
/// force is nearest.
class TensionAllocator {
 public:
  TensionAllocator(int tendons, int forces);

  struct Result {
    TendonVector tension_N;
    double residual_Nm = 0;         // norm of the force not produced
    Status status = Status::kOk;    // kLimitedTensionMax: force not reachable within the bounds
    int iterations = 0;
  };

  /// force = jacobian * T; jacobian is (2K x M), for example -dL/d(us, vs) transposed.
  Result Allocate(const Eigen::Ref<const Eigen::MatrixXd>& jacobian, ConstVectorRef force_Nm, double min_tension_N,
                  double max_tension_N) noexcept;

 private:
  int tendons_, forces_;
  Eigen::VectorXd multiplier_;      // warm start
};

/// 2K x M: generalised force on the sections' arc motion per unit tension, at (us, vs).
void SectionForcePerTension(const Body& body, const BendingVector& us_vs, MatrixRef jacobian) noexcept;

}  // namespace tendril::model
