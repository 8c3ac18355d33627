// The simulator driven by measured signals: each cut of the chain separately, from the signals on its near
// side to those on its far side. Same laws and effects as the plant. Knows nothing of files, noise or fits.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::sim {

/// One run on a uniform grid, S samples. A matrix without columns was not measured; gaps of NaN are bridged
/// linearly. The first sample belongs to a robot started straight and at pretension, as every plant is, with
/// all friction memories relaxed: either it is released there (its signals move at once where straight is no
/// equilibrium) or it has come to rest by then.
struct ReplaySignals {
  double step_s = 0;
  /// Samples are states at rest, too far apart to show motion: the body is in equilibrium at each, friction
  /// memories go straight from one to the next, and velocities are taken as zero. `time_s` (S, rising from 0)
  /// then gives the times for time-dependent laws; without it they are step_s apart.
  bool at_rest = false;
  Eigen::VectorXd time_s;
  LoadCellPlace load_cell = LoadCellPlace::kMotorSide;
  Eigen::MatrixXd torque_target_Nm;  // S x M, as sent
  Eigen::MatrixXd torque_actual_Nm;  // as reported by the drive
  Eigen::MatrixXd motor_angle_rad;   // smooth enough to differentiate, with its derivatives
  Eigen::MatrixXd motor_velocity_radps;
  Eigen::MatrixXd motor_acceleration_radps2;
  Eigen::MatrixXd tension_N;  // load cell, as read with the gain and offset of the robot before its effects
  /// S x M, or empty: where no cell measures the tension on the body, which then follows from the tendon's
  /// stretch between motor and body.
  Eigen::Matrix<char, Eigen::Dynamic, Eigen::Dynamic> no_cell;
  /// Total bending (us, vs) per section from a tracker, S x 2K, smooth; the tendons' shortening is corrected
  /// to it (across gaps by the difference on either side).
  Eigen::MatrixXd bending_rad;
  /// M, or empty: motors without data; they may have no motor angles either. For a body driven by load cells
  /// before the pulleys, these slide by the body's shortening and the tendon's stretch; all other functions
  /// need the motor.
  std::vector<char> no_motor;
  /// From the stamp of a target to its action; a target stamped when sent acts at the next SYNC, one bus
  /// cycle later.
  double command_delay_s = 1e-3;
  /// Targets sent from one sample to the next, including the sample's own; those in between are interpolated
  /// linearly.
  int commands_a_sample = 1;
};

/// Motion of the body at every sample.
struct BodyMotion {
  Eigen::MatrixXd q;               // S x 2N
  Eigen::MatrixXd tip_m;           // S x 3, as the tracker would report it (its own effects included)
  Eigen::MatrixXd tip_rotation;    // S x 3 rotation vector of the tip frame in F_0, as reported
  Eigen::MatrixXd bending_rad;     // S x 2K: (us, vs) of every section, as reported
  Eigen::MatrixXd shortening_m;    // S x M: d of every tendon on the grid, corrected to the measured bending:
                                   // the difference is spread evenly over a section's units
  Eigen::MatrixXd tension_base_N;  // S x M, the tensions that drove it
};

/// One robot with its effects. Const functions may run at once in several threads.
class Replay {
 public:
  /// Throws std::invalid_argument when the robot has no actuation or an effect that does not exist.
  explicit Replay(const RobotParameters& robot);
  ~Replay();
  Replay(Replay&&) noexcept;
  Replay& operator=(Replay&&) noexcept;

  // Throws std::invalid_argument for required signals that are missing or of the wrong size,
  // std::runtime_error for a tendon without any value.

  /// C1: torque that the drives would report, S x M, from the targets, each held until the next. Until the
  /// first of them acts, they report what they did in the first sample (where torques were reported).
  Eigen::MatrixXd ActualTorque(const ReplaySignals& signals) const;

  /// C2: load cell reading from actual torque and motor motion. With the cell on the robot's side the pulleys
  /// are included and `shortening_m` is needed.
  Eigen::MatrixXd CellFromTorque(const ReplaySignals& signals, const Eigen::MatrixXd& shortening_m) const;

  /// C3: load cell reading from motor angle and shortening. `zero_rad` (M, or empty for zeros) is subtracted
  /// from the motor angles first.
  Eigen::MatrixXd CellFromStretch(const ReplaySignals& signals, const Eigen::MatrixXd& shortening_m,
                                  const Eigen::VectorXd& zero_rad = {}) const;

  /// Motor angles (M) of the pose from which every simulation starts, for a log with another zero: with them
  /// subtracted, the tendons' stretch gives `reading_N` (M) in the mean of the first `samples`, over which
  /// the robot rests. 0 for a tendon without a reading (NaN) or below its cell's zero.
  Eigen::VectorXd ZeroAtRest(const ReplaySignals& signals, const Eigen::MatrixXd& shortening_m, int samples,
                             const Eigen::VectorXd& reading_N) const;

  enum class DrivenBy {
    kCell,    // C4, C5: tensions as read by the load cells
    kTorque,  // tensions that C2 derives from torque and motor motion
    kMotor,   // motor angles through the tendons' stiffness
  };
  /// How finely the body's motion is integrated.
  enum class Steps {
    kFine,    // to 0.01 mm at the tip for motions up to 10 Hz
    kCoarse,  // in steps of up to 2.1 ms, also over several samples: for the difference of two replays, where
              // most of the error cancels
  };
  /// Motion of the body in time; throws std::runtime_error when it cannot be integrated. Where pulleys lie
  /// between the known tension and the base, they slide by (s + d) / 2 with s measured and d from this
  /// motion, not from the measured bending, whose noise would act as friction. For samples at rest: the
  /// equilibria, each reached from the one before.
  BodyMotion Body(const ReplaySignals& signals, DrivenBy driven_by, Steps steps = Steps::kFine) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::sim
