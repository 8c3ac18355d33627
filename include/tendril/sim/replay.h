// The simulator driven by what was measured: each cut of the chain by itself, from the signals on its near
// side to those on its far side. Same laws and effects as the plant. Knows nothing of files, noise or fits.
#pragma once

#include <Eigen/Core>
#include <memory>

#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::sim {

/// One run on a uniform grid, S samples; a matrix without columns was not measured. The run begins with the
/// robot straight, at rest, at pretension (as every plant does).
struct ReplaySignals {
  double step_s = 0;
  LoadCellPlace load_cell = LoadCellPlace::kMotorSide;
  Eigen::MatrixXd torque_target_Nm;  // S x M, as sent
  Eigen::MatrixXd torque_actual_Nm;  // as the drive reports it
  Eigen::MatrixXd motor_angle_rad;   // smooth enough to differentiate, with its derivatives
  Eigen::MatrixXd motor_velocity_radps;
  Eigen::MatrixXd motor_acceleration_radps2;
  Eigen::MatrixXd tension_N;  // load cell, as read
  /// Total bending (us, vs) per section that a tracker shows, S x 2K, smooth; where it is known the tendons'
  /// shortening is corrected to it.
  Eigen::MatrixXd bending_rad;
  /// From the stamp of a target to the moment it acts; a target stamped when sent acts at the next SYNC, one
  /// bus cycle later.
  double command_delay_s = 1e-3;
};

/// Motion of the body, every `stride` grid samples.
struct BodyMotion {
  Eigen::MatrixXd q;               // R x 2N
  Eigen::MatrixXd tip_m;           // R x 3, as the tracker would report it (its own effects included)
  Eigen::MatrixXd tip_rotation;    // R x 3 rotation vector of the tip frame in F_0, as reported
  Eigen::MatrixXd shortening_m;    // S x M: d of every tendon on the grid, corrected to the measured bending
  Eigen::MatrixXd tension_base_N;  // S x M, what drove it
};

class Replay {
 public:
  /// Throws std::invalid_argument when the robot has no actuation or an effect that does not exist.
  explicit Replay(const RobotParameters& robot);
  ~Replay();
  Replay(Replay&&) noexcept;
  Replay& operator=(Replay&&) noexcept;

  /// C1: torque that the drives would report, S x M, from the targets.
  Eigen::MatrixXd ActualTorque(const ReplaySignals& signals) const;

  /// C2: load cell reading from actual torque and motor motion. With the cell on the robot's side the pulleys
  /// are part of it and `shortening_m` is needed.
  Eigen::MatrixXd CellFromTorque(const ReplaySignals& signals, const Eigen::MatrixXd& shortening_m) const;

  /// C3: load cell reading from motor angle and shortening.
  Eigen::MatrixXd CellFromStretch(const ReplaySignals& signals, const Eigen::MatrixXd& shortening_m) const;

  enum class DrivenBy {
    kCell,    // C4, C5: tensions as read by the load cells
    kTorque,  // no cell: tensions that C2 makes of torque and motor motion
    kMotor,   // motor angles through the tendons' stiffness (no cell, no torque)
  };
  /// Motion of the body in time; throws std::runtime_error when it cannot be integrated.
  BodyMotion Body(const ReplaySignals& signals, DrivenBy driven_by, int stride) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::sim
