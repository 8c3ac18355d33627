// Additions of effects between a drive's command and the tension at the robot's base, and at the sensors.
// Plain numbers for sums and bounds, objects for laws. Knows nothing of solvers.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <memory>
#include <vector>

namespace tendril::sim {

/// Motor shaft, as input of a torque law.
struct Shaft {
  double angle_rad = 0;
  double velocity_radps = 0;
  double dahl = 0;        // zeta of the Coulomb friction in [-1, 1]: the smooth sign of the motion
  double dahl_slope = 0;  // d zeta / d angle [1/rad]
};

/// Torque against the shaft's positive direction, and its slopes, which only speed up the solver's iteration.
struct ShaftTorque {
  double torque_Nm = 0;
  double per_angle = 0;     // [N·m/rad]
  double per_velocity = 0;  // [N·m·s/rad]
};

/// Torque on the rotor beyond the nominal friction.
class ShaftLaw {
 public:
  virtual ~ShaftLaw() = default;
  virtual ShaftTorque Against(const Shaft& shaft) const noexcept = 0;
};

/// Length of the tendon beyond its elastic stretch. Its memory moves only at Commit.
class StretchLaw {
 public:
  virtual ~StretchLaw() = default;
  virtual std::unique_ptr<StretchLaw> Clone() const = 0;
  /// Starts at rest under this tension; `stiffness_Npm` of the whole tendon.
  virtual void Start(double tension_N, double stiffness_Npm) noexcept = 0;
  /// Extra length [m] at time_s, at or after the last commit. Continuous across commits.
  virtual double Peek(double time_s) const noexcept = 0;
  /// `tension_N` on the motor's side was reached at time_s.
  virtual void Commit(double time_s, double tension_N) noexcept = 0;
};

/// A StretchLaw that copies with its owner.
class OwnedStretch {
 public:
  explicit OwnedStretch(std::unique_ptr<StretchLaw> law) : law_(std::move(law)) {}
  OwnedStretch(const OwnedStretch& other) : law_(other.law_->Clone()) {}
  OwnedStretch& operator=(const OwnedStretch& other) {
    if (this != &other) law_ = other.law_->Clone();
    return *this;
  }
  OwnedStretch(OwnedStretch&&) noexcept = default;
  OwnedStretch& operator=(OwnedStretch&&) noexcept = default;
  ~OwnedStretch() = default;

  StretchLaw* operator->() noexcept { return law_.get(); }
  const StretchLaw* operator->() const noexcept { return law_.get(); }

 private:
  std::unique_ptr<StretchLaw> law_;
};

/// One tendon's drivetrain beyond the robot file.
struct TendonLaws {
  // Drive: input of the torque loop relative to the torque sent.
  double command_delay_s = 0;
  double torque_limit_Nm = std::numeric_limits<double>::infinity();

  // Motor.
  std::vector<std::shared_ptr<const ShaftLaw>> shaft{};

  /// Full play at the motor shaft [rad], within which the spool rests. A run begins with the play taken up in
  /// the pulling direction.
  double play_rad = 0;
  /// Spool radius gained per radian wound up since the start.
  double spool_growth_mprad = 0;

  // Tendon.
  double slack_m = 0;  // longer than the pretensioned tendon by this
  std::vector<OwnedStretch> stretch{};
};

/// Errors that the sensors add. Gain and offset of a load cell are numbers of the robot file.
struct SensorLaws {
  explicit SensorLaws(int tendons)
      : encoder_offset_rad(Eigen::VectorXd::Zero(tendons)), cell_drift_Nps(Eigen::VectorXd::Zero(tendons)) {}

  Eigen::VectorXd encoder_offset_rad;  // reported motor angle = angle + this
  Eigen::VectorXd cell_drift_Nps;      // load cell shows tension + this x time since the start
  /// Rotation vector of R: the tracker reports p = R p + offset and the orientation R R_WT.
  Eigen::Vector3d tracker_turn_rad = Eigen::Vector3d::Zero();
  Eigen::Vector3d tracker_offset_m = Eigen::Vector3d::Zero();
};

}  // namespace tendril::sim
