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
  static constexpr double kZeroed_s = 0.1;  // a load cell's noise is a twentieth of it in the mean

  /// `tables` has one entry a tendon and, like `body`, outlives the estimator.
  Estimator(const RobotParameters& robot, const model::Body& body,
            const std::vector<std::shared_ptr<const model::CapstanTable>>& tables, double period_s);

  /// Fills the estimate part of `output` from the drives' raw values.
  ///
  /// With J the shortening's Jacobian by bending, the least squares' weights are all alike, so the covariance
  /// is B diag(s^2) B^T, B = (J^T J)^-1 J^T [rad^2], s^2 [m^2] of each tendon's shortening: two encoder steps
  /// (now and at zero, each step^2 / 12) and, over stiffness squared, what is not known of the motor-side
  /// tension: noise and resolution of the load cell, or of the torque where there is none; and, where
  /// friction lies between sensor and motor side, the part of it that has not built up, (1 - z^2) h^2 / 3
  /// with h half the tension between pulling and paying out. What the robot file has wrong is not in it.
  ///
  /// Directions of bend that no tendon's path shows are those of the balance, see below, as unsure as
  /// anywhere.
  ///
  /// A tendon whose cell shows no pull hangs, and shows nothing of the shape: as its tension goes from
  /// kTaut to kSlack of the least tension, or to the cell's noise, its weight goes to zero and its variance
  /// beyond that of anywhere in its range; taut again it counts as before a few cycles later. While one
  /// hangs, each tendon counts by its variance beside what is expected: last cycle's bend, gone on towards
  /// the shape that balances the tensions (stiffness, weight, the other section's tendons), as sure as last
  /// cycle's covariance was and a little less, until it may be anywhere that a section bends.
  void Step(const CycleInput& input, CycleOutput& output) noexcept;

  /// Of each tendon's path in the body, as of the last Step: displacement less stretch.
  const TendonVector& shortening_m() const noexcept { return shortening_m_; }
  /// From 0, a tendon that hangs, to 1.
  const TendonVector& weight() const noexcept { return weight_; }

  /// Shape of the robot at pretension: straight, or where tendons do not pull every way as their tensions
  /// bent it when the encoders were zeroed; before, as the least ones do.
  const BendingVector& pretension_rad() const noexcept { return pretension_rad_; }
  /// Displacement of each tendon there.
  const TendonVector& pretension_m() const noexcept { return pretension_m_; }

  /// Declares the present encoder positions to be those of the robot at pretension, under the tensions of the
  /// last kZeroed_s.
  void ZeroDisplacement(const CycleInput& input) noexcept;

  void Remember(StateArchive& archive) noexcept;

 private:
  struct Tendon {
    double travel_per_count_m, rated_torque_Nm, torque_scale, newton_per_mV, cell_offset_N, stiffness_Npm,
        travel_m, efficiency, coulomb_Nm, pulley_coulomb_N;
    double sensor_variance_N2;  // of the load cell; without one, of the torque as tension before losses
    LoadCellPlace place;
    double slack_N, range_variance_m2;
    double taut;  // from 0, a tendon that hangs, to 1
    std::int32_t zero_counts = 0;
    model::StopOperators<4> presliding;
  };

  // Of this cycle's bend, before the tendons are asked: how far from last cycle's, a root of the covariance,
  // and what that counts beside the tendons.
  struct Expected {
    BendingVector step_rad;
    BendingMatrix root_rad, count;
  };

  BendingVector Settling(const TendonVector& tension_base_N) noexcept;
  void EstimateBending(const TendonVector& counts, const TendonVector& variance_m2,
                       const Expected& expected) noexcept;

  const model::Body& body_;
  const std::vector<std::shared_ptr<const model::CapstanTable>>& tables_;
  double min_tension_N_, max_bending_rad_, straight_rad2_;
  double kept_, grips_;                   // of what is expected, and of a tendon's grip, in a cycle
  double averaged_;                       // a cycle's share of the mean over kZeroed_s
  BendingVector stiffness_Nm_;            // both entries of a section alike
  std::vector<double> curvature_mprad2_;  // a bend b of a section makes paths b^2 / 2 of this shorter
  std::vector<Tendon> tendons_;
  void FindPretension();

  bool pulls_every_way_;
  // At the least tensions, and by how much more for each tendon's: of (us, vs) and of the displacements.
  Eigen::MatrixXd bend_per_N_, shortening_per_N_;
  BendingVector rest_rad_;
  TendonVector rest_m_, tension_base_N_, stretch_m_;  // the last two as means over kZeroed_s
  BendingVector pretension_rad_, bending_rad_;
  TendonVector pretension_m_, shortening_m_, weight_;
  BendingMatrix covariance_rad2_;
  UnitVector q_, unit_force_Nm_;
};

}  // namespace tendril::control
