// Motion of a body under tensions given over time, integrated by SUNDIALS CVODE. A pure function: no files,
// no clock. For programs and tests, not for the tick: allocates.
#pragma once

#include <Eigen/Core>
#include <functional>

#include "tendril/model/body.h"

namespace tendril::model {

/// Tensions at the base over time: linear between knots. Column k of `tension_N` (M x knots) holds at
/// `time_s[k]`.
struct TensionProfile {
  Eigen::VectorXd time_s;  // strictly increasing, at least one
  Eigen::MatrixXd tension_N;
};

/// Integrates ddq = ForwardDynamics(q, dq, TendonForce(q, T(t))) from the first knot to the last and calls
/// `sample` at the first knot and every `step_s` after it, as long as the last knot is not passed.
/// `relative_tolerance` bounds CVODE's local error of every component, with an absolute floor of the same
/// fraction of 0.01 rad and 1 rad/s. Throws std::invalid_argument for invalid sizes or values,
/// std::runtime_error when CVODE gives up.
void Simulate(const Body& body, const TensionProfile& profile, ConstVectorRef initial_q,
              ConstVectorRef initial_dq, double step_s, double relative_tolerance,
              const std::function<void(double time_s, ConstVectorRef q, ConstVectorRef dq)>& sample);

}  // namespace tendril::model
