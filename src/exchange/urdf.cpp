// URDF has joints of one freedom between links, so that a unit is four joints and three small links before
// its disk. Knows nothing of tendons, which the format does not have.
#include <cmath>

#include "tendril/core/limits.h"
#include "tendril/exchange/robot_model.h"
#include "unit_chain.h"
#include "xml.h"

namespace tendril::exchange {
namespace {

// Simulators refuse links without mass. What these have is taken from the disk's.
constexpr double kLinkShare = 1e-3;

/// Its share of the disk's mass and inertia, centred `centre_m` along its z.
void Inertial(Xml& xml, const Unit& unit, double share, double centre_m) {
  const double xx = share * unit.inertia_xx_kgm2, zz = share * unit.inertia_zz_kgm2;
  xml.Open("<inertial>");
  xml.Line("<origin xyz=\"0 0 {:.10g}\"/>", centre_m);
  xml.Line("<mass value=\"{:.10g}\"/>", share * unit.mass_kg);
  xml.Line("<inertia ixx=\"{0:.10g}\" ixy=\"0\" ixz=\"0\" iyy=\"{0:.10g}\" iyz=\"0\" izz=\"{1:.10g}\"/>", xx,
           zz);
  xml.Close("inertial");
}

void Joint(Xml& xml, const Unit& unit, const Hinge& hinge, const std::string& parent,
           const std::string& child, double along_m) {
  const double limit_rad = unit.limit_rad / 2;
  xml.Open("<joint name=\"unit{}_{}\" type=\"revolute\">", unit.number, hinge.name);
  xml.Line("<parent link=\"{}\"/>", parent);
  xml.Line("<child link=\"{}\"/>", child);
  xml.Line("<origin xyz=\"0 0 {:.10g}\"/>", along_m);
  xml.Line("<axis xyz=\"{}\"/>", hinge.axis);
  xml.Line("<limit lower=\"{:.10g}\" upper=\"{:.10g}\" effort=\"{:.10g}\" velocity=\"{:g}\"/>", -limit_rad,
           limit_rad, 2 * unit.stiffness_Nm * limit_rad, kMostSpeed_radps);
  xml.Line("<dynamics damping=\"{:.10g}\" friction=\"0\"/>", 2 * unit.damping_Nms);
  if (hinge.follows) xml.Line("<mimic joint=\"unit{}_{}\"/>", unit.number, hinge.follows);
  xml.Close("joint");
}

/// Links and joints of one unit from the frame of the disk before to that of its own, "disk3".
void AddUnit(Xml& xml, const Unit& unit, double disk_radius_m) {
  std::string parent = unit.number == 1 ? "base_link" : fmt::format("disk{}", unit.number - 1);
  double before_m = 0;
  for (const Hinge& hinge : kHinges) {
    const bool last = &hinge == &kHinges.back();
    const std::string child = fmt::format("unit{}_{}_link", unit.number, hinge.name);
    const double end_m = unit.length_m - Along(unit, hinge);
    xml.Open("<link name=\"{}\">", child);
    Inertial(xml, unit, last ? 1 - 3 * kLinkShare : kLinkShare, last ? end_m : 0);
    if (last) {
      xml.Line(
          "<visual><origin xyz=\"0 0 {:.10g}\"/><geometry><cylinder radius=\"{:.6g}\" length=\"{:.6g}\"/>"
          "</geometry></visual>",
          end_m, disk_radius_m, unit.length_m / 10);
    }
    xml.Close("link");
    Joint(xml, unit, hinge, parent, child, Along(unit, hinge) - before_m);
    before_m = Along(unit, hinge);
    parent = child;
  }
  xml.Line("<link name=\"disk{}\"/>", unit.number);
  xml.Open("<joint name=\"disk{}_fixed\" type=\"fixed\">", unit.number);
  xml.Line("<parent link=\"{}\"/>", parent);
  xml.Line("<child link=\"disk{}\"/>", unit.number);
  xml.Line("<origin xyz=\"0 0 {:.10g}\"/>", unit.length_m - before_m);
  xml.Close("joint");
}

std::vector<std::string> LeftOut(const RobotParameters& robot) {
  std::vector<std::string> lines = {
      "Tendons, and with them motors, pulleys and their friction: the format has none.",
      "The backbone's stiffness and its rest shape: joints have no springs.",
      "The bend of a section as a limit: each unit's joints have its equal share in each direction."};
  if (robot.body.gravity_W_mps2.norm() > 0) lines.emplace_back("Gravity: the simulator's own acts.");
  if (robot.body.tip_force_W_N.norm() > 0) lines.emplace_back("The constant force on the tip.");
  for (std::string& line : LeftOutOfBoth(robot)) lines.push_back(std::move(line));
  return lines;
}

}  // namespace

Exported Urdf(const RobotParameters& robot) {
  const model::Body body(robot.body);
  const std::vector<Unit> units = UnitsOf(robot, body);
  Exported exported{.text = {}, .left_out = LeftOut(robot)};
  Xml xml;
  xml.Line("<?xml version=\"1.0\"?>");
  xml.Comment(Heading(robot,
                      "Joints unit1_u and unit1_v turn by half of the unit's bend; the others mimic them.",
                      exported.left_out));
  xml.Open("<robot name=\"{}\">", robot.name);
  xml.Line("<link name=\"base_link\"/>");
  for (const Unit& unit : units) AddUnit(xml, unit, DrawnDisk_m(robot.body));
  xml.Line("<link name=\"tip\"/>");
  xml.Line("<joint name=\"tip_fixed\" type=\"fixed\"><parent link=\"disk{}\"/><child link=\"tip\"/></joint>",
           units.size());
  xml.Close("robot");
  exported.text = std::move(xml).Text();
  return exported;
}

}  // namespace tendril::exchange
