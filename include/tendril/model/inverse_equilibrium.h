// Tensions for which the body's equilibrium, unit by unit, has a required bend or tip position. For programs,
// not for the tick: allocates, bounded iterations. Knows nothing of transmissions and motors.
#pragma once

#include <Eigen/Core>
#include <string>

#include "tendril/core/status.h"
#include "tendril/model/body.h"
#include "tendril/model/inverse.h"

namespace tendril::model {

struct TensionedShape {
  Eigen::VectorXd tension_N;  // M
  Eigen::VectorXd q;          // 2N
  double target_error = 0;    // distance from the target: rad for sums of bending, m for a tip
  double residual_Nm = 0;     // largest component of the balance residual
  // kTargetUnreachable: nearest shape within the tension bounds; kSolverFallback: no stable shape found
  Status status = Status::kOk;
  int iterations = 0;
};

/// "no stable equilibrium found (...)" where there is none (kSolverFallback), without the remedy; else empty.
std::string WhyNoShape(const TensionedShape& shape);

/// Unknown unit angles q and tensions T with
///   balance(q, dq, ddq) = -sum_j T_j dL_j/dq  (every unit's equation),   g(q) = target,   T_min <= T <=
///   T_max,
/// and among these the least sum (T - T_min)^2; g is the sums (us, vs) of each section or the tip in F_0.
/// Solved by sequential quadratic programming on T, with q on the stable branch continued from the straight
/// shape. No warm start: the same input gives the same result. A target counts as reached within 1e-7 rad or
/// 10 nm.
class InverseEquilibrium {
 public:
  /// 0 <= min_tension_N <= max_tension_N (infinity: no limit); throws std::invalid_argument.
  /// Of `pairs` the sum counts what the motors' pulls change, and no tendon has less than the robot's
  /// minimum, as TensionAllocator says.
  InverseEquilibrium(const Body& body, double min_tension_N, double max_tension_N, TendonPairs pairs = {});

  /// Static: the sums (us, vs) per section, 2K [rad].
  TensionedShape ForBending(ConstVectorRef us_vs) const;
  /// In motion: the units share the section's rates equally [rad/s, rad/s^2] and every unit's equation of
  /// motion holds.
  TensionedShape ForBending(ConstVectorRef us_vs, ConstVectorRef dus_dvs, ConstVectorRef ddus_ddvs) const;

  /// Static: the tip in F_0 [m]; `max_bending_rad` bounds the constant-curvature shape from which the search
  /// starts.
  TensionedShape ForTip(const Eigen::Vector3d& target_W_m, double max_bending_rad) const;
  /// In motion: tip velocity and acceleration in F_0; the sections' rates are those of least norm (for one
  /// section: least squares) that give them, shared equally by the units.
  TensionedShape ForTip(const Eigen::Vector3d& target_W_m, const Eigen::Vector3d& velocity_W_mps,
                        const Eigen::Vector3d& acceleration_W_mps2, double max_bending_rad) const;

 private:
  struct Motion;
  struct State;
  enum class Goal { kBending, kTip };

  bool Balance(State& state, const Motion* motion) const;
  Eigen::VectorXd Value(Goal goal, const Eigen::VectorXd& q) const;
  void Approach(Goal goal, const Eigen::VectorXd& target, const Motion* motion, double least_N,
                double tolerance, State& state) const;
  State ContinueToBending(const Eigen::VectorXd& us_vs, double least_N) const;
  State ContinueToTip(const Eigen::Vector3d& target_W_m, double least_N) const;
  Motion TipMotion(const Eigen::VectorXd& q, const Eigen::Vector3d& velocity,
                   const Eigen::Vector3d& acceleration) const;
  TensionedShape Finish(Goal goal, const Eigen::VectorXd& target, const State& state) const;

  const Body& body_;
  double min_tension_N_, max_tension_N_;
  TendonPairs pairs_;
  Eigen::MatrixXd sum_;     // 2K x 2N: q to (us, vs)
  Eigen::MatrixXd spread_;  // 2N x 2K: (us, vs) to q of the arc shape
};

}  // namespace tendril::model
