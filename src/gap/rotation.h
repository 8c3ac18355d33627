// Rotations as vectors and back.
#pragma once

#include <Eigen/Geometry>

namespace tendril::gap {

/// Axis times angle, angle in [0, pi].
inline Eigen::Vector3d RotationVector(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd turn(R);
  return turn.angle() * turn.axis();
}

inline Eigen::Matrix3d Rotation(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  return angle > 0 ? Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix()
                   : Eigen::Matrix3d::Identity();
}

}  // namespace tendril::gap
