// The body alone, moved in time by tensions that may depend on its own motion: a fixed-step implicit
// integrator, fast enough to run some hundred times inside a fit. Knows nothing of motors, sensors or logs.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "body_laws.h"
#include "tendril/model/body.h"

namespace tendril::sim {

/// Tensions at the robot's base, one a tendon, as functions of the body's motion at one time.
class TensionSource {
 public:
  struct Tension {
    double value_N = 0;
    double stiffness_Npm = 0;  // -dT/d(shortening)
    double damping_Nspm = 0;   // -dT/d(shortening rate)
  };
  virtual ~TensionSource() = default;
  /// What is known from outside is read at time_s from now on.
  virtual void MoveTo(double time_s) noexcept = 0;
  /// Memories as committed last.
  virtual void Evaluate(const double* shortening_m, const double* shortening_rate_mps,
                        Tension* tension) const noexcept = 0;
  /// Memories follow to an accepted motion at the time moved to.
  virtual void Commit(const double* shortening_m, const double* shortening_rate_mps) noexcept = 0;
};

/// Generalised-alpha in the form that fulfils the equations of motion at the end of every step (second order,
/// damps what it cannot resolve), Newton with mass, stiffness and damping of a shape near by whose inverse is
/// kept while the shape moves little; the tendons' own stiffness and damping enter anew each time, as an
/// update of rank M.
class BodyStepper {
 public:
  /// A copy of `laws` goes with the motion from here. Newton's matrix serves until a tension has moved by
  /// near_N.
  BodyStepper(const model::Body& body, const BodyLaws& laws, double near_N);

  /// Begins at time_s where the body is, free to move. False: the tensions make no sense.
  bool LetGo(TensionSource& source, double time_s);
  /// To rest at time_s, at the equilibrium reached downhill from the present shape. False: there is none
  /// near.
  bool Settle(TensionSource& source, double time_s);
  /// One step to `to_s`; parts of it when the iteration does not converge, and rest at the equilibrium there
  /// when that does not help. False: no motion can be found.
  bool StepTo(TensionSource& source, double to_s);

  const Eigen::VectorXd& q() const { return q_; }
  /// At the shape accepted last.
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
  double time_s_ = 0, to_s_ = 0;  // accepted, of the iterate

  // Accepted: shape, rate, acceleration, the algorithm's acceleration.
  Eigen::VectorXd q_, v_, a_, algorithm_;
  Eigen::VectorXd shortening_, shortening_rate_, tension_;
  // The iterate.
  Eigen::VectorXd q_new_, v_new_, a_new_, residual_, step_, law_force_;
  Eigen::MatrixXd jacobian_, weighted_;  // dL/dq; the same times the share of the base tension that arrives
  std::vector<TensionSource::Tension> pull_;
  Eigen::VectorXd previous_shortening_, previous_rate_, previous_tension_;  // of the iterate before

  // Newton's matrix at a shape near by for a step h: inverse of the body's part, and of it
  // across = inverse Jw^T and small = J inverse Jw^T for the tendons'.
  Eigen::VectorXd damping_, reference_q_, reference_tension_;
  Eigen::MatrixXd mass_, stiffness_, matrix_, inverse_, reference_jacobian_, across_, small_;
  double reference_h_ = 0;
  std::vector<int> active_;
  Eigen::MatrixXd active_matrix_;
  Eigen::VectorXd active_rhs_;
};

}  // namespace tendril::sim
