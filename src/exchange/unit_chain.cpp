#include "unit_chain.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "tendril/core/version.h"
#include "tendril/exchange/robot_model.h"
#include "tendril/model/shape_points.h"

namespace tendril::exchange {

std::vector<Unit> UnitsOf(const RobotParameters& robot, const model::Body& body) {
  std::vector<Unit> units;
  for (const SectionParameters& s : robot.body.sections) {
    for (int i = 0; i < s.units; ++i) {
      const int at = static_cast<int>(units.size());
      units.push_back({.number = at + 1,
                       .length_m = s.unit_length_m,
                       .mass_kg = s.unit_mass_kg,
                       .inertia_xx_kgm2 = s.disk_inertia_xx_kgm2,
                       .inertia_zz_kgm2 = s.disk_inertia_zz_kgm2,
                       .stiffness_Nm = body.unit_stiffness_Nm(at),
                       .damping_Nms = s.bending_damping_Nms,
                       .rest_rad = body.rest_bend_rad(at),
                       .core_radius_m = s.core_radius_m,
                       .limit_rad = robot.limits.max_bending_rad / s.units});
    }
  }
  units.back().mass_kg += robot.body.tip_payload_kg;
  return units;
}

// The chord is 1 - 2 p + 2 p cos(t / 2) of the length, that of an arc sin(t / 2) / (t / 2).
double HingePlace(const Unit& unit) {
  const double half = unit.limit_rad / 2;
  if (half < 1e-2) return 1. / 6;
  return (1 - std::sin(half) / half) / (2 * (1 - std::cos(half)));
}

double Along(const Unit& unit, const Hinge& hinge) {
  return unit.length_m * (hinge.at_end ? 1 - HingePlace(unit) : HingePlace(unit));
}

std::vector<Eigen::Vector3d> HolesOf(const model::Body& body, int tendon) {
  const Eigen::VectorXd straight = Eigen::VectorXd::Zero(body.dof());
  const Eigen::Matrix3Xd at = model::TendonHoles(body, straight, tendon);
  std::vector<Eigen::Vector3d> holes;
  for (Eigen::Index i = 0; i < at.cols(); ++i) holes.emplace_back(at(0, i), at(1, i), 0);
  return holes;
}

std::vector<std::string> Heading(const RobotParameters& robot, const std::string& meaning,
                                 const std::vector<std::string>& left_out) {
  std::vector<std::string> lines = {
      fmt::format("Robot {}, written by tendril {} ({}). SI units; the straight robot points along +z.",
                  robot.name, Version(), GitRevision()),
      meaning, "Not carried by this format:"};
  for (const std::string& line : left_out) lines.push_back("* " + line);
  return lines;
}

std::vector<std::string> LeftOutOfBoth(const RobotParameters& robot) {
  std::vector<std::string> lines;
  if (!robot.effects.empty()) {
    std::vector<std::string> names;
    for (const EffectSetting& effect : robot.effects) names.push_back(effect.name);
    lines.push_back(fmt::format("Effects of the robot file: {}.", fmt::join(names, ", ")));
  }
  if (robot.actuation) {
    lines.emplace_back(
        "Drives and sensors: the bus and its cycle, torque steps, encoder counts, noise, delays.");
  }
  if (!robot.uncertain.empty())
    lines.emplace_back("How well numbers are known (within: ...): each is taken as it stands.");
  return lines;
}

// The rotation of the hinges, y x x y, has the quaternion (cos U cos V, -sin V, sin U cos V, 0); that of the
// arc is (cos t/2, -v/t sin t/2, u/t sin t/2, 0).
Eigen::VectorXd HingeAngles(model::ConstVectorRef q) {
  Eigen::VectorXd angles(q.size());
  for (Eigen::Index i = 0; i + 1 < q.size(); i += 2) {
    const double half = std::hypot(q[i], q[i + 1]) / 2;
    const double over = half > 1e-8 ? std::sin(half) / (2 * half) : 0.5;
    angles[i] = std::atan2(over * q[i], std::cos(half));
    angles[i + 1] = std::asin(std::clamp(over * q[i + 1], -1.0, 1.0));
  }
  return angles;
}

}  // namespace tendril::exchange
