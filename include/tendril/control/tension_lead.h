// Leads commanded tensions no faster than the motors behind them can follow. Knows nothing of friction, nor
// of what the robot really does.
#pragma once

#include <Eigen/Core>

#include "tendril/core/limits.h"
#include "tendril/model/body.h"

namespace tendril::control {

class StateArchive;

/// Where friction is compensated nothing but their inertia holds the motors back: a tension that jumps leaves
/// them swinging, and spools overrun. So a ramp leads to the tensions that are wanted, all of them at one
/// pace, slow enough that no section's bend, F T / K with F the force per tension and K its stiffness,
/// changes faster than `rate_radps`; and T'' = w^2 (ramp - T) - 2 w T', w = 4 / gather_s, smooths its
/// corners, so that the shape that follows has an acceleration of at most w rate / e.
class TensionLead {
 public:
  /// `body` is used here only.
  TensionLead(const model::Body& body, double rate_radps, double gather_s, double period_s);

  /// From here on, at rest.
  void Start(const TendonVector& tension_N) noexcept;
  /// One cycle on the way to `wanted_N`, each tendon by at most `step_N` on its ramp.
  const TendonVector& Step(const TendonVector& wanted_N, double step_N) noexcept;

  void Remember(StateArchive& archive) noexcept;

 private:
  double step_rad_, corner_radps_, period_s_;
  Eigen::MatrixXd bend_per_tension_;
  TendonVector ramp_N_, tension_N_, rate_Nps_;
};

}  // namespace tendril::control
