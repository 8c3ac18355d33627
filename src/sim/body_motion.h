// The motion of the body alone under tensions that may depend on that motion: a fixed-step implicit
// integrator, fast enough for some hundred runs inside a fit. Knows nothing of motors, sensors or logs.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "body_laws.h"
#include "tendril/model/body.h"

namespace tendril::sim {

/// Tolerance on the last correction of the bending in a step; with a nearby matrix the remaining error is
/// some per cent of it.
inline constexpr double kBendTolerance_rad = 1e-5;

/// Tensions at the robot's base, one per tendon, as functions of the body's motion at one time.
class TensionSource {
 public:
  struct Tension {
    double value_N = 0;
    double stiffness_Npm = 0;  // -dT/d(shortening)
    double damping_Nspm = 0;   // -dT/d(shortening rate)
  };
  virtual ~TensionSource() = default;
  /// External signals are read at time_s from now on.
  virtual void MoveTo(double time_s) noexcept = 0;
  /// With the memories as last committed.
  virtual void Evaluate(const double* shortening_m, const double* shortening_rate_mps,
                        Tension* tension) const noexcept = 0;
  /// Moves the memories to an accepted motion at the time moved to.
  virtual void Commit(const double* shortening_m, const double* shortening_rate_mps) noexcept = 0;
};

/// Generalised-alpha in the form that satisfies the equations of motion at the end of every step (second
/// order, damps unresolved modes). Newton uses mass, stiffness and damping of a nearby shape, whose inverse
/// is kept while the shape moves little; the tendons' own stiffness and damping enter each time as an update
/// of rank M.
class BodyStepper {
 public:
  /// A copy of `laws` moves with the body. Newton's matrix is kept until a tension has changed by near_N.
  BodyStepper(const model::Body& body, const BodyLaws& laws, double near_N);

  /// Starts at time_s from the present shape, free to move. False: the tensions are invalid.
  bool LetGo(TensionSource& source, double time_s);
  /// Brings the body to rest at time_s, at the equilibrium downhill from the present shape. False: there is
  /// none near.
  bool Settle(TensionSource& source, double time_s);
  /// One step to `to_s`; smaller steps when the iteration does not converge, and rest at the equilibrium
  /// there when that fails too. False: no motion is found.
  bool StepTo(TensionSource& source, double to_s);

  const Eigen::VectorXd& q() const { return q_; }
  /// At the last accepted shape.
  const Eigen::VectorXd& shortening_m() const { return shortening_; }
  const Eigen::VectorXd& tension_N() const { return tension_; }

 private:
  void MoveTo(TensionSource& source, double time_s);
  bool TryStep(TensionSource& source, double h);
  void SteepenToSecants();
  bool Descend(TensionSource& source);
  bool Relax(TensionSource& source);
  void Commit(TensionSource& source);
  void Evaluate(const TensionSource& source);
  bool Refresh(double h);
  void Solve(double h);

  const model::Body& body_;
  BodyLaws laws_;
  double near_N_;
  bool plain_;  // no laws
  model::Body::Workspace workspace_;
  int n_, m_;
  double time_s_ = 0, to_s_ = 0;  // time accepted, time of the iterate

  // Accepted: shape, rate, acceleration, the algorithm's acceleration.
  Eigen::VectorXd q_, v_, a_, algorithm_;
  Eigen::VectorXd shortening_, shortening_rate_, tension_;
  // The iterate.
  Eigen::VectorXd q_new_, v_new_, a_new_, residual_, step_, law_force_;
  Eigen::MatrixXd jacobian_, weighted_;  // dL/dq; the same times the share of base tension that arrives
  std::vector<TensionSource::Tension> pull_;
  Eigen::VectorXd previous_shortening_, previous_rate_, previous_tension_;  // of the previous iterate

  // Newton's matrix at a nearby shape for a step h: inverse of the body's part, and of it across = inverse
  // Jw^T and small = J inverse Jw^T for the tendons'.
  Eigen::VectorXd reference_q_, reference_tension_;
  Eigen::MatrixXd mass_, stiffness_, matrix_, inverse_, reference_jacobian_, across_, small_;
  double reference_h_ = 0;
  std::vector<int> active_;
  Eigen::MatrixXd active_matrix_;
  Eigen::VectorXd active_rhs_;
};

}  // namespace tendril::sim
