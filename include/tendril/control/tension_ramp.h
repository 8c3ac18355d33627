// Ramps commanded tensions no faster than the motors can follow. Knows nothing of friction or of the robot's
// measured state.
#pragma once

#include <Eigen/Core>

#include "tendril/core/limits.h"
#include "tendril/model/body.h"

namespace tendril::control {

class StateArchive;

/// With friction compensated only inertia resists the motors: after a step in tension they oscillate, and
/// spools overrun. So a ramp moves all tensions together towards their targets, slowly enough that no
/// section's bend, F T / K with F the force per tension and K its stiffness, changes faster than
/// `rate_radps`; and T'' = w^2 (ramp - T) - 2 w T', w = 4 / gather_s, rounds its corners, so that the shape
/// has an acceleration of at most w rate / e.
class TensionRamp {
 public:
  /// `body` is used in the constructor only.
  TensionRamp(const model::Body& body, double rate_radps, double gather_s, double period_s);

  /// Starts at rest from `tension_N`.
  void Start(const TendonVector& tension_N) noexcept;
  /// One cycle towards `target_N`; each tendon's ramp moves by at most `step_N`.
  const TendonVector& Step(const TendonVector& target_N, double step_N) noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  double step_rad_, corner_radps_, period_s_;
  Eigen::MatrixXd bend_per_tension_;
  TendonVector ramp_N_, tension_N_, rate_Nps_;
};

}  // namespace tendril::control
