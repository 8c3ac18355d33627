#include "sensors.h"

#include "laws.h"
#include "tendril/sim/effects.h"

namespace tendril::sim {

Eigen::Matrix3d Rotation(const Eigen::Vector3d& vector) {
  const double angle = vector.norm();
  return angle > 0 ? Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix()
                   : Eigen::Matrix3d::Identity();
}

Sensors::Sensors(const ActuationParameters& actuation, const SensorLaws& laws)
    : laws_(laws), tracker_R_(Rotation(laws.tracker_turn_rad)), tracker_plane_(laws.tracker_turn_rad.z()) {
  for (const TendonDriveParameters& t : actuation.tendons)
    offset_N_.push_back(t.load_cell.place == LoadCellPlace::kNone ? 0 : t.load_cell.offset_N);
}

TrackerPlacement PlacementOfTracker(const RobotParameters& robot) {
  const SensorLaws sensors = PlantLaws::Of(robot).sensor;
  return {Rotation(sensors.tracker_turn_rad), sensors.tracker_offset_m};
}

}  // namespace tendril::sim
