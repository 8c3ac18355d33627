// What the robot does, from what the drives report: tendon displacement, tension at the base, bending of each
// section with its covariance and the tip, by least squares of the straight-tendon shortening with the
// tendons' stretch taken out. Knows nothing of commands.
#pragma once

#include <Eigen/Cholesky>
#include <memory>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/stop_operator.h"

namespace tendril::control {

class StateArchive;

class Estimator {
 public:
  static constexpr double kSlack = 0.07, kTaut = 0.2;

  /// `tables` has one entry a tendon and, like `body`, outlives the estimator.
  Estimator(const RobotParameters& robot, const model::Body& body,
            const std::vector<std::shared_ptr<const model::CapstanTable>>& tables);

  /// Fills the estimate part of `output` from the drives' raw values.
  ///
  /// With J the shortening's Jacobian by bending, the least squares' weights are all alike, so the covariance
  /// is B diag(s^2) B^T, B = (J^T J)^-1 J^T [rad^2], s^2 [m^2] of each tendon's shortening: two encoder steps
  /// (now and at zero, each step^2 / 12) and, over stiffness squared, what is not known of the motor-side
  /// tension: noise and resolution of the load cell, or of the torque where there is none; and, where
  /// friction lies between sensor and motor side, the part of it that has not built up, (1 - z^2) h^2 / 3
  /// with h half the tension between pulling and paying out. What the robot file has wrong is not in it.
  ///
  /// A tendon whose cell shows no pull hangs, and shows nothing of the shape: as its tension goes from
  /// kTaut to kSlack of the least tension, or to the cell's noise, its weight goes to zero and its variance
  /// to that of anywhere in its range. What no tendon shows is taken to be straight, give or take all that a
  /// section bends.
  void Step(const CycleInput& input, CycleOutput& output) noexcept;

  /// Of each tendon's path in the body, as of the last Step: displacement less stretch.
  const TendonVector& shortening_m() const noexcept { return shortening_m_; }
  /// From 0, a tendon that hangs, to 1.
  const TendonVector& weight() const noexcept { return weight_; }

  /// Declares the present encoder positions to be those of the straight robot at pretension.
  void ZeroDisplacement(const CycleInput& input) noexcept;

  void Remember(StateArchive& archive) noexcept;

 private:
  struct Tendon {
    double travel_per_count_m, rated_torque_Nm, torque_scale, newton_per_mV, cell_offset_N, stiffness_Npm,
        travel_m, efficiency, coulomb_Nm, pulley_coulomb_N;
    double sensor_variance_N2;  // of the load cell; without one, of the torque as tension before losses
    LoadCellPlace place;
    double slack_N, range_variance_m2;
    std::int32_t zero_counts = 0;
    model::StopOperators<4> presliding;
  };

  void EstimateBending(const TendonVector& variance_m2, BendingMatrix& covariance_rad2) noexcept;

  const model::Body& body_;
  const std::vector<std::shared_ptr<const model::CapstanTable>>& tables_;
  double min_tension_N_, max_bending_rad_;
  std::vector<Tendon> tendons_;
  BendingVector bending_rad_;
  TendonVector shortening_m_, weight_;
  UnitVector q_;
};

}  // namespace tendril::control
