// Static equilibria of a body whose motors hold their angles: each tendon is a spring between its spool and
// the body that pulls and never pushes. For programs and the diagnosis, not for the tick: may allocate.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>

#include "tendril/model/body.h"

namespace tendril::model {

/// A tendon whose spool has taken in s (pull) has the tension k w log(1 + exp((s - d) / w)) there, with d its
/// shortening in the body: k (s - d) when it is tight and 0 when it is slack, smooth over the width w.
/// Friction between spool and base lets the body have exp(-loss) of it.
class HeldStatics {
 public:
  /// `stiffness_Npm` of each tendon, M entries, and `width_m` are above 0. The body is referred to.
  HeldStatics(const Body& body, ConstVectorRef stiffness_Npm, double width_m);

  /// ln of each tendon's tension at its spool over that at the base, M entries, from now on: above 0 where
  /// the tendon was pulled last, below where it was paid out. 0 at first.
  void SetLoss(ConstVectorRef loss);

  /// Newton with a line search from q, dof entries, to the equilibrium at a pull of M entries; false where it
  /// does not arrive, with q as far as it came. Fast where it is called for states that resemble each other.
  bool Solve(ConstVectorRef pull_m, VectorRef q);
  /// What must be added to hold q [N·m]: 0 in equilibrium. dof entries.
  void Residual(ConstVectorRef pull_m, ConstVectorRef q, VectorRef force_Nm);
  /// d residual / dq at a state, dof x dof [N·m/rad], factored; valid until the next call.
  const Eigen::PartialPivLU<Eigen::MatrixXd>& Tangent(ConstVectorRef pull_m, ConstVectorRef q);
  /// At the base, in the last state looked at [N], M entries.
  const Eigen::VectorXd& tension_N() const { return tension_; }

 private:
  void Linearise(ConstVectorRef pull_m, ConstVectorRef q);

  const Body* body_;
  Eigen::VectorXd stiffness_, stiffness_at_base_;  // as the body feels it
  double width_;
  Eigen::VectorXd shortening_, tension_, tendon_force_, force_, trial_force_, step_, trial_, spring_;
  Eigen::MatrixXd length_jacobian_, tangent_;
  Eigen::PartialPivLU<Eigen::MatrixXd> factors_;
  bool factored_ = false;  // they are worth a try
};

}  // namespace tendril::model
