// State estimate from drive feedback: tendon displacement, base tension, bending of each section with
// covariance, and tip, by least squares on the straight-tendon shortening with tendon stretch removed. Knows
// nothing of commands.
#pragma once

#include <Eigen/Cholesky>
#include <memory>
#include <vector>

#include "tendril/core/cycle.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"
#include "tendril/model/capstan.h"
#include "tendril/model/stop_operator.h"
#include "tendril/model/tendon_pairs.h"

namespace tendril::control {

class StateArchive;

class Estimator {
 public:
  static constexpr double kSlack = 0.07, kTaut = 0.2;
  static constexpr double kZeroed_s = 0.1;  // averaging time for zeroing

  /// `tables` has one entry per tendon and, like `body`, outlives the estimator. `unseen_rad2` of
  /// model::UnseenBending, if any, is part of every covariance that Step gives.
  Estimator(const RobotParameters& robot, const model::Body& body,
            const std::vector<std::shared_ptr<const model::CapstanTable>>& tables, double period_s,
            const BendingMatrix& unseen_rad2 = {});

  /// Fills the estimates in `output` from the drives' raw values.
  ///
  /// With J the Jacobian of shortening by bending and equal weights, the covariance is B diag(s^2) B^T with B
  /// = (J^T J)^-1 J^T [rad^2] and s^2 [m^2] the variance of each tendon's shortening. It holds two encoder
  /// steps (now and at zero, each step^2 / 12) and the variance of the motor-side tension over stiffness
  /// squared: noise and resolution of the load cell, or of the torque without one. Where friction lies
  /// between sensor and motor side, its part that has not built up adds (1 - z^2) h^2 / 3, h being half the
  /// difference between pulling and paying out. Of errors of the model `unseen_rad2` alone is included, of
  /// errors of the robot file none.
  ///
  /// Bending directions that no tendon measures come from the static balance, see below, with the prior's
  /// full variance.
  ///
  /// Of a pair only what the motor pulls is measured. The tension that both have without it follows from the
  /// last cycle's shape, and the two displacements are one reading.
  ///
  /// A tendon whose cell shows no tension is slack and does not measure the shape. As its tension falls from
  /// kTaut to kSlack of the minimum tension, or to the cell's noise, its weight falls to zero and its
  /// variance grows to that of its full range; a few cycles after it is taut again it has its full weight.
  /// While a tendon is slack, all tendons are weighted by variance against a prediction: last cycle's bending
  /// moved towards the shape that balances the tensions (stiffness, weight, tendons of the other section).
  /// The prediction has last cycle's covariance, which grows until it spans the section's range.
  void Step(const CycleInput& input, CycleOutput& output) noexcept;

  /// Shortening of each tendon's path in the body at the last Step: displacement less stretch.
  const TendonVector& shortening_m() const noexcept { return shortening_m_; }
  /// Per tendon, from 0 (slack) to 1 (taut).
  const TendonVector& weight() const noexcept { return weight_; }

  /// Shape of the robot at pretension. Straight, unless the tendons do not pull in every direction: then the
  /// shape under the tensions when the encoders were zeroed; before that, under the minimum tensions.
  const BendingVector& pretension_rad() const noexcept { return pretension_rad_; }
  /// Displacement of each tendon there.
  const TendonVector& pretension_m() const noexcept { return pretension_m_; }

  /// Takes the present encoder positions as those at pretension, under the mean tensions of the last
  /// kZeroed_s.
  void ZeroDisplacement(const CycleInput& input) noexcept;

  void Archive(StateArchive& archive) noexcept;

 private:
  struct Tendon {
    double travel_per_count_m, rated_torque_Nm, torque_scale, newton_per_mV, cell_offset_N, stiffness_Npm,
        travel_m, efficiency, coulomb_Nm, pulley_coulomb_N;
    double sensor_variance_N2;  // of the load cell; without one, of the torque as tension before losses
    LoadCellPlace place;
    double slack_N, range_variance_m2;
    double taut;   // from 0 (slack) to 1
    double share;  // of what the motor pulls, which this tendon of a pair gains; 0: a motor of its own

    bool in_pair() const noexcept { return share > 0; }
    std::int32_t zero_counts = 0;
    model::StopOperators<4> presliding;
  };

  // Prediction of this cycle's bending: step from last cycle's, a root of its covariance, and its weight in
  // the least squares.
  struct Expected {
    BendingVector step_rad;
    BendingMatrix root_rad, count;
  };

  // On both sides of the pulleys; the variance is that of motor_N.
  struct Tension {
    double motor_N, base_N, variance_N2;
  };

  double ReadTendon(int tendon, const DriveFeedback& drive, CycleOutput& output) noexcept;
  Tension PairTension(int tendon, double z, double torque_Nm) const noexcept;
  static Tension TensionOf(const Tendon& tendon, const model::CapstanTable& pulleys, double z,
                           double torque_Nm, double cell_N) noexcept;
  static double MotorSideVariance(const Tendon& tendon, const model::CapstanTable& pulleys, double z,
                                  double base_N) noexcept;
  void BendingWithAllTaut(const TendonVector& tension_base_N, const TendonVector& variance_m2) noexcept;
  void BendingWithSlack(const TendonVector& tension_base_N, TendonVector& variance_m2) noexcept;
  BendingVector Settling(const TendonVector& tension_base_N) noexcept;
  void EstimateBending(const TendonVector& counts, const TendonVector& variance_m2,
                       const Expected& expected) noexcept;

  const model::Body& body_;
  const std::vector<std::shared_ptr<const model::CapstanTable>>& tables_;
  model::TendonPairs pairs_;
  double min_tension_N_, max_bending_rad_, straight_rad2_;
  double kept_, grips_;         // decay of the prediction and recovery of a tendon's weight, per cycle
  double averaged_;             // weight of one cycle in the mean over kZeroed_s
  BendingVector stiffness_Nm_;  // both entries of a section are equal
  std::vector<double>
      curvature_mprad2_;  // bending b of a section shortens tendon paths by b^2 / 2 times this
  std::vector<Tendon> tendons_;
  void FindPretension();
  void FindUnpulled() noexcept;

  bool pulls_every_way_;
  // Shape and displacements at the minimum tensions, and their derivatives by each tendon's tension.
  Eigen::MatrixXd bend_per_N_, shortening_per_N_;
  BendingVector rest_rad_;
  TendonVector rest_N_, rest_m_, tension_base_N_, stretch_m_;  // the last two are means over kZeroed_s
  TendonVector unpulled_N_;  // tensions of pairs at the last cycle's shape if their motor did not pull
  BendingVector pretension_rad_, bending_rad_;
  TendonVector pretension_m_, shortening_m_, weight_;
  BendingMatrix covariance_rad2_;  // as far as the sensors make it
  BendingMatrix unseen_rad2_;
  UnitVector q_, unit_force_Nm_;
};

}  // namespace tendril::control
