// Static equilibria of a body under tensions and a tip force, followed from zero tension; natural frequencies
// about them. For programs and the simulator, not for the tick: may allocate, bounded work.
#pragma once

#include <Eigen/Core>
#include <string>

#include "tendril/model/body.h"

namespace tendril::model {

enum class StaticsResult {
  kConverged,
  kBuckled,  // the branch from zero tension lost stability on the way: its tangent stiffness became singular
  kNoSolution,  // Newton could not continue the branch
};

struct Equilibrium {
  StaticsResult result = StaticsResult::kNoSolution;
  Eigen::VectorXd q;         // dof entries; where the branch ended when it did not converge
  double load_fraction = 0;  // fraction of the load reached: 1 when converged
  double residual_Nm = 0;    // largest component of the residual
  int iterations = 0;        // total Newton steps
};

/// Follows the equilibrium from the unloaded rest shape (gravity and the body's own tip force acting) to the
/// given tensions and tip wrench, all raised together.
Equilibrium SolveStatics(const Body& body, ConstVectorRef tension_N, const TipWrench& tip);
/// Why there is no equilibrium and the remedy, as a clause; empty when it converged.
std::string WhyNoEquilibrium(const Equilibrium& found);
/// Minimum of the potential reached downhill from a start: Newton with the exact tangent and a line search;
/// result kNoSolution when it does not converge and kBuckled when what it converges to is unstable.
Equilibrium SolveStaticsFrom(const Body& body, ConstVectorRef start_q, ConstVectorRef tension_N,
                             const Eigen::Vector3d& tip_force_W_N);

/// Undamped natural frequencies [Hz], ascending, one a coordinate, about an equilibrium at constant tensions:
/// f = sqrt(lambda) / 2 pi of K x = lambda H x. A mode in which the equilibrium is unstable comes out
/// negative: -f is its growth rate / 2 pi.
Eigen::VectorXd NaturalFrequencies(const Body& body, ConstVectorRef equilibrium_q, ConstVectorRef tension_N,
                                   const Eigen::Vector3d& tip_force_W_N);

}  // namespace tendril::model
