// A run of the plant as exact signals: what perfect sensors would have logged, with exact derivatives. Knows
// nothing of replay's laws.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <numbers>

#include "motions.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/plant.h"
#include "tendril/sim/replay.h"

namespace tendril::test {

struct Recording {
  sim::ReplaySignals signals;      // load cell on the motor's side, bending not measured
  Eigen::MatrixXd tension_base_N;  // S x M
  Eigen::MatrixXd shortening_m;    // S x M
  Eigen::MatrixXd sliding;         // S x M, z of the pulleys
  Eigen::MatrixXd q;               // S x 2N
  Eigen::MatrixXd tip_m;           // S x 3
  Eigen::MatrixXd tip_rotation;    // S x 3, rotation vectors
};

/// Sensors whose steps are far below everything that is compared.
inline RobotParameters WithSharpSensors(RobotParameters robot) {
  for (auto& t : robot.actuation->tendons) {
    t.drive.encoder_counts_per_turn = 10'000'000;
    t.load_cell.resolution_V = 1e-9;
  }
  return robot;
}

using TorqueProgram = std::function<Eigen::VectorXd(double t_s)>;

/// `samples` milliseconds under the program, one torque a millisecond; `hold_ms` before, unrecorded, under
/// the first torque.
inline Recording Record(const RobotParameters& robot, const TorqueProgram& torque, int samples,
                        int hold_ms = 0) {
  constexpr TimeNs kBefore = 10 * kNsPerUs;  // the acceleration is a difference over this
  const RobotParameters sharp = WithSharpSensors(robot), folded = sim::FoldEffects(robot);
  sim::Plant plant(sharp, {.sensor_noise = false, .relative_tolerance = 1e-8, .absolute_tolerance = 1e-9});
  const int m = plant.tendons(), n = plant.body().dof();
  for (int i = 0; i < hold_ms; ++i) {
    plant.SetTorque(torque(0));
    plant.Advance(kNsPerMs);
  }
  Recording r;
  r.signals.step_s = 1e-3;
  r.signals.command_delay_s = 0;
  for (auto* matrix : {&r.signals.torque_target_Nm, &r.signals.torque_actual_Nm, &r.signals.motor_angle_rad,
                       &r.signals.motor_velocity_radps, &r.signals.motor_acceleration_radps2,
                       &r.signals.tension_N, &r.tension_base_N, &r.shortening_m, &r.sliding}) {
    matrix->setZero(samples, m);
  }
  r.q.resize(samples, n);
  r.tip_m.resize(samples, 3);
  r.tip_rotation.resize(samples, 3);
  Eigen::VectorXd before = Eigen::VectorXd::Zero(m);
  for (int i = 0; i < samples; ++i) {
    const std::vector<sim::TendonSensors> sensors = plant.ReadSensors();
    for (int j = 0; j < m; ++j) {
      const sim::TendonState& t = plant.tendon()[static_cast<std::size_t>(j)];
      const auto& p = sharp.actuation->tendons[static_cast<std::size_t>(j)];
      const auto& real = folded.actuation->tendons[static_cast<std::size_t>(j)];
      const sim::TendonSensors& sensor = sensors[static_cast<std::size_t>(j)];
      r.signals.torque_actual_Nm(i, j) = t.motor_torque_Nm / real.motor.torque_scale;
      r.signals.motor_angle_rad(i, j) =
          2 * std::numbers::pi * sensor.encoder_counts / p.drive.encoder_counts_per_turn;
      r.signals.motor_velocity_radps(i, j) = t.motor_velocity_radps;
      r.signals.tension_N(i, j) = sensor.load_cell_V / p.load_cell.gain_VpN - p.load_cell.offset_N;
      r.tension_base_N(i, j) = t.tension_base_N;
      r.shortening_m(i, j) = t.body_shortening_m;
      r.sliding(i, j) = t.sliding;
    }
    r.q.row(i) = plant.q().transpose();
    const sim::TrackerReading tracker = plant.ReadTracker();
    r.tip_m.row(i) = tracker.tip_W_m.transpose();
    const Eigen::AngleAxisd turn(tracker.orientation_WT);
    r.tip_rotation.row(i) = (turn.angle() * turn.axis()).transpose();

    const Eigen::VectorXd now = torque(i * 1e-3);
    r.signals.torque_target_Nm.row(i) = now.transpose();
    plant.SetTorque(now);
    // Acceleration by differences on both sides of the sample, whose torque has a corner.
    const auto velocity = [&](int j) {
      return plant.tendon()[static_cast<std::size_t>(j)].motor_velocity_radps;
    };
    const double half = ToSeconds(kBefore);
    plant.Advance(kBefore);
    for (int j = 0; j < m; ++j) {
      const double after = (velocity(j) - r.signals.motor_velocity_radps(i, j)) / half;
      r.signals.motor_acceleration_radps2(i, j) = i == 0 ? after : 0.5 * (after + before[j]);
    }
    plant.Advance(kNsPerMs - 2 * kBefore);
    Eigen::VectorXd early(m);
    for (int j = 0; j < m; ++j) early[j] = velocity(j);
    plant.Advance(kBefore);
    for (int j = 0; j < m; ++j) before[j] = (velocity(j) - early[j]) / half;
  }
  return r;
}

/// Torque of each motor for a base tension while the motor pulls, on the bus's per mille.
class PullTorque {
 public:
  explicit PullTorque(const RobotParameters& robot)
      : drives_(robot.actuation->tendons), capstan_(drives_[0].transmission, 20) {}
  double For(int j, double base_N, double z = 1) const {
    const auto& d = drives_[static_cast<std::size_t>(j)];
    return OnTheBus(
        d, capstan_.BaseToMotor(base_N, z) * d.SpoolTravelPerMotorRad() * std::pow(d.gear.efficiency, -z) +
               d.motor.coulomb_friction_Nm * z);
  }
  int count() const { return static_cast<int>(drives_.size()); }

 private:
  std::vector<TendonDriveParameters> drives_;
  model::CapstanTable capstan_;
};

/// Half a second of rest, then slow triangles of each tendon in turn, 0.5 to 5 N in 4 s.
inline TorqueProgram Triangles(const RobotParameters& robot) {
  return [pull = PullTorque(robot)](double t) {
    Eigen::VectorXd torque(pull.count());
    for (int j = 0; j < pull.count(); ++j) {
      const double phase = std::fmod(std::max(0.0, t - 0.5) / 4 + static_cast<double>(j) / pull.count(), 1.0);
      const double ramp = std::min(1.0, std::max(0.0, t - 0.5));
      const double up = phase < 0.25 ? 4 * phase : phase < 0.5 ? 2 - 4 * phase : 0;
      torque[j] = pull.For(j, 0.3 + ramp * (0.2 + 4.5 * up), ramp * (phase >= 0.25 && phase < 0.5 ? -1 : 1));
    }
    return torque;
  };
}

/// Rest, then 1 to 10 Hz at once about a bent shape, with jumps of the mean.
inline TorqueProgram Multisine(const RobotParameters& robot) {
  return [pull = PullTorque(robot)](double t) {
    Eigen::VectorXd torque(pull.count());
    const double ramp = std::min(1.0, 2 * std::max(0.0, t - 0.5));
    for (int j = 0; j < pull.count(); ++j) {
      double base = 2.0 + (std::fmod(t, 3.0) < 1.5 ? 1.0 : 0.0) * (j == 0 ? 1 : -1);
      for (int k = 1; k <= 10; ++k) {
        base += 0.6 * std::sin(2 * std::numbers::pi * k * t + 1.7 * k * k + 2.3 * j * (k + 1));
      }
      torque[j] = pull.For(j, 0.3 + ramp * (std::max(0.3, base) - 0.3));
    }
    return torque;
  };
}

inline double Rms(const Eigen::MatrixXd& difference) {
  return std::sqrt(difference.squaredNorm() / static_cast<double>(difference.rows()));
}

}  // namespace tendril::test
