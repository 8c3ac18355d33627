// Where the parts of a bent robot are, as points and frames to be drawn or compared. For programs, not for
// the tick: allocates.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "tendril/model/body.h"

namespace tendril::model {

/// The rotation as a unit quaternion with w >= 0.
Eigen::Quaterniond UnitQuaternion(const Eigen::Matrix3d& R);

/// Frames of the base and of the N units' ends in F_0, from the base on.
std::vector<Pose> UnitPoses(const Body& body, ConstVectorRef q);

/// Frames of the base disk and of the D other disks in F_0, from the base on; those of the units' ends where
/// every unit ends at a disk.
std::vector<Pose> DiskPoses(const Body& body, ConstVectorRef q);

/// `points` >= 2 positions [m, F_0] of the backbone, equally spaced by arc length from base to tip; each unit
/// is a curve of constant strain; by the arc length of the unstrained backbone.
Eigen::Matrix3Xd BackbonePoints(const Body& body, ConstVectorRef q, int points);

/// Positions [m, F_0] of a tendon's (0-based) hole in the base disk and in each disk up to the one where it
/// ends: between them it is straight.
Eigen::Matrix3Xd TendonHoles(const Body& body, ConstVectorRef q, int tendon);

}  // namespace tendril::model
