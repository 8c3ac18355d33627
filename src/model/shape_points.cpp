#include "tendril/model/shape_points.h"

#include <algorithm>
#include <cmath>

#include "unit_joint.h"

namespace tendril::model {
namespace {

std::vector<double> UnitLengths(const Body& body) {
  std::vector<double> length_m;
  for (const SectionParameters& section : body.parameters().sections)
    length_m.insert(length_m.end(), static_cast<std::size_t>(section.units), section.unit_length_m);
  return length_m;
}

}  // namespace

Eigen::Quaterniond UnitQuaternion(const Eigen::Matrix3d& R) {
  Eigen::Quaterniond turn(R);
  turn.normalize();
  if (turn.w() < 0) turn.coeffs() *= -1;
  return turn;
}

std::vector<Pose> UnitPoses(const Body& body, ConstVectorRef q) {
  std::vector<Pose> poses(static_cast<std::size_t>(body.units()) + 1);
  body.Poses(q, std::span(poses).subspan(1));
  return poses;
}

std::vector<Pose> DiskPoses(const Body& body, ConstVectorRef q) {
  const std::vector<Pose> ends = UnitPoses(body, q);
  std::vector<Pose> poses{ends.front()};
  for (int disk = 0; disk < body.disks(); ++disk)
    poses.push_back(ends[static_cast<std::size_t>(body.disk_unit(disk)) + 1]);
  return poses;
}

Eigen::Matrix3Xd BackbonePoints(const Body& body, ConstVectorRef q, int points) {
  const std::vector<Pose> ends = UnitPoses(body, q);
  const std::vector<double> length_m = UnitLengths(body);
  Eigen::Matrix3Xd at(3, points);
  std::size_t unit = 0;
  double begin_m = 0;
  for (int i = 0; i < points; ++i) {
    const double arc_m = body.parameters().length_m() * i / (points - 1);
    while (unit + 1 < length_m.size() && arc_m > begin_m + length_m[unit]) begin_m += length_m[unit++];
    const double share = std::clamp((arc_m - begin_m) / length_m[unit], 0.0, 1.0);
    at.col(i) = ends[unit].p_WA + ends[unit].R_WA * body.PoseWithin(static_cast<int>(unit), q, share).p_WA;
  }
  return at;
}

Eigen::Matrix3Xd TendonHoles(const Body& body, ConstVectorRef q, int tendon) {
  const std::vector<Pose> disks = DiskPoses(body, q);
  const std::vector<double> length_m = UnitLengths(body);
  const int count = body.tendon_end_disk(tendon);
  Eigen::Matrix3Xd at(3, count + 1);
  double arc_m = 0;
  std::size_t unit = 0;
  for (Eigen::Index i = 0; i < at.cols(); ++i) {
    const auto disk = static_cast<std::size_t>(i);
    at.col(i) = disks[disk].p_WA + disks[disk].R_WA * body.parameters().HoleOf(tendon, arc_m);
    if (i < count) {
      while (unit <= static_cast<std::size_t>(body.disk_unit(static_cast<int>(i)))) arc_m += length_m[unit++];
    }
  }
  return at;
}

}  // namespace tendril::model
