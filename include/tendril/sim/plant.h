// The simulated robot: drives' torque in, encoders, load cells and tip pose out. Full N-unit Kane dynamics
// with motors, gears, spools, stretchable tendons and pulley friction, integrated by CVODE. Knows nothing of
// CAN or the controller.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <vector>

#include "tendril/core/clock.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::sim {

struct PlantOptions {
  std::uint64_t seed = 1;  // of the sensor noise
  bool sensor_noise = true;
  double relative_tolerance = 1e-7;
  double absolute_tolerance = 3e-8;  // bending [rad]; other states scaled to it
};

/// True state of one tendon's drivetrain. Angle, velocity and torque of a pair's second tendon are those of
/// the first, turned round.
struct TendonState {
  double motor_angle_rad = 0;
  double motor_velocity_radps = 0;
  double motor_torque_Nm = 0;    // electromagnetic, after the torque loop's lag
  double spool_pull_m = 0;       // s
  double body_shortening_m = 0;  // d
  double tension_motor_N = 0;    // spool side of the pulleys
  double tension_base_N = 0;     // robot side
  double sliding = 0;            // z of the pulley, +1: the motor pulls
};

/// Sensor readings.
struct TendonSensors {
  std::int32_t encoder_counts = 0;
  double torque_Nm = 0;    // as the drive estimates it from the current, with noise
  double load_cell_V = 0;  // quantised, with noise; 0 without a load cell
};

struct TrackerReading {
  Eigen::Vector3d tip_W_m{0, 0, 0};
  Eigen::Quaterniond orientation_WT{1, 0, 0, 0};
};

class Plant {
 public:
  /// Starts straight, at rest, with every tendon at its rest tension and the torque that holds it. Throws
  /// std::invalid_argument when the robot has no actuation.
  explicit Plant(const RobotParameters& robot, const PlantOptions& options = {});
  ~Plant();
  Plant(const Plant&) = delete;
  Plant& operator=(const Plant&) = delete;

  int tendons() const;
  const model::Body& body() const;

  /// Sets the torque command of each motor's torque loop from now on [N·m], one per tendon; that of a pair's
  /// second tendon is not used.
  void SetTorque(const Eigen::Ref<const Eigen::VectorXd>& torque_Nm);
  /// Integrates by dt > 0. Throws std::runtime_error with the solver's reason when it gives up.
  void Advance(TimeNs dt_ns);

  TimeNs time_ns() const;
  const Eigen::VectorXd& q() const;                // unit bending (u_1, v_1, ...) [rad]
  const Eigen::VectorXd& dq() const;               // [rad/s]
  const std::vector<TendonState>& tendon() const;  // true values at time_ns()
  model::Pose TipPose() const;
  /// Sensor values at time_ns(); each call draws new noise.
  std::vector<TendonSensors> ReadSensors();
  TrackerReading ReadTracker();

  struct Counters {
    std::uint64_t solver_steps = 0, rhs_evaluations = 0, jacobian_evaluations = 0, newton_iterations = 0;
  };
  Counters counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tendril::sim
