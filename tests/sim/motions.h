// Torques for the rig's tests and benchmark: what a controller would send, quantised as on the bus.
// Knows nothing of controllers.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "support/rig_file.h"
#include "tendril/core/robot.h"
#include "tendril/model/capstan.h"

namespace tendril::test {

/// A whole number of per mille of the drive's rated torque.
inline double OnTheBus(const TendonDriveParameters& drive, double torque_Nm) {
  const double permille = 1e-3 * drive.drive.rated_torque_Nm;
  return permille * std::nearbyint(torque_Nm / permille);
}

/// A circle as slow as the paper's (12 s a turn): each tendon in turn pulled to 6 N at the base and paid out,
/// never slack, with the paper's law from base tension to torque.
class CircleTorque {
 public:
  explicit CircleTorque(const RobotParameters& robot)
      : drives_(robot.actuation->tendons), capstan_(drives_[0].transmission, 20) {}

  Eigen::VectorXd At(double t_s) const {
    const int count = static_cast<int>(drives_.size());
    Eigen::VectorXd torque(count);
    for (int j = 0; j < count; ++j) {
      const double phase = 2 * std::numbers::pi * (t_s / 12 - static_cast<double>(j) / count);
      const double c = std::cos(phase), s = std::sin(phase);
      const double base_N = 1.5 + (c > 0 ? 4.5 * std::min(1.0, t_s / 2) * c * c : 0);
      const double rate = c > 0 ? -s * c : -0.05 * s;
      const double z = std::tanh(60 * rate) * std::min(1.0, t_s);
      const auto& d = drives_[static_cast<std::size_t>(j)];
      const double motor_N = capstan_.BaseToMotor(base_N, z);
      torque[j] = OnTheBus(d, motor_N * d.SpoolTravelPerMotorRad() * std::pow(d.gear.efficiency, -z) +
                                  d.motor.coulomb_friction_Nm * z);
    }
    return torque;
  }

 private:
  std::vector<TendonDriveParameters> drives_;
  model::CapstanTable capstan_;
};

}  // namespace tendril::test
