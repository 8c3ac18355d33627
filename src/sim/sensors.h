// What encoder, load cell and tracker report of the truth. One model for the plant, which adds noise, delay
// and resolution, and for the replay, which compares with recorded readings.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "tendon_laws.h"
#include "tendril/core/robot.h"
#include "tendril/model/body.h"

namespace tendril::sim {

/// Of a rotation vector.
Eigen::Matrix3d Rotation(const Eigen::Vector3d& vector);

class Sensors {
 public:
  /// Offsets of cells are the robot file's, all other errors the laws'.
  Sensors(const ActuationParameters& actuation, const SensorLaws& laws);

  /// The motor's angle as the encoder reports it, and back [rad].
  double Reported(int tendon, double motor_rad) const { return motor_rad + laws_.encoder_offset_rad[tendon]; }
  double Motor(int tendon, double reported_rad) const {
    return reported_rad - laws_.encoder_offset_rad[tendon];
  }

  /// The tension that the cell shows, its gain aside, and back [N]. Offset and drift are added one after the
  /// other, so plant and replay round alike.
  double Shown(int tendon, double tension_N, double time_s) const {
    return tension_N + offset_N_[At(tendon)] + laws_.cell_drift_Nps[tendon] * time_s;
  }
  double Tension(int tendon, double shown_N, double time_s) const {
    return shown_N - offset_N_[At(tendon)] - laws_.cell_drift_Nps[tendon] * time_s;
  }

  /// The tip's pose in the tracker's frame.
  model::Pose Tracked(const model::Pose& tip) const {
    return {tracker_R_ * tip.R_WA, tracker_R_ * tip.p_WA + laws_.tracker_offset_m};
  }
  /// (us, vs) in the tracker's frame. A bend is relative to the section's own base: of a rotated frame only
  /// the rotation about z is visible.
  Eigen::Vector2d Tracked(const Eigen::Vector2d& bend_rad) const { return tracker_plane_ * bend_rad; }

 private:
  static std::size_t At(int tendon) { return static_cast<std::size_t>(tendon); }

  SensorLaws laws_;
  std::vector<double> offset_N_;  // 0 without a cell
  Eigen::Matrix3d tracker_R_;
  Eigen::Rotation2Dd tracker_plane_;
};

}  // namespace tendril::sim
