// The body in MJCF: a body a disk, with all hinges of its unit (no light links between them), equalities that
// tie the two hinges of a direction, a spring between the centres of its disks, and a spatial tendon through
// the holes of each tendon.
#include <fmt/ranges.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <stdexcept>

#include "mjcf_motors.h"
#include "tendril/exchange/robot_model.h"
#include "tendril/model/tendon_pairs.h"
#include "unit_chain.h"

namespace tendril::exchange {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Holes = std::vector<std::vector<Eigen::Vector3d>>;  // of each tendon

/// One robot on its way into a file.
struct Parts {
  const RobotParameters& robot;
  model::Body body;
  std::vector<Unit> units;
  Holes holes;
  std::vector<SpoolSlide> slides;  // none: the controls are tensions
  double timestep_s = 0;
  bool tip_force() const { return robot.body.tip_force_W_N.norm() > 0; }
};

/// Of the straight robot at pretension with its motors blocked [rad/s].
double HighestRate(const Parts& p) {
  const VectorXd straight = VectorXd::Zero(p.body.dof());
  const VectorXd tension_N = model::RestTensions_N(p.robot);
  MatrixXd mass(p.body.dof(), p.body.dof()), stiffness(p.body.dof(), p.body.dof());
  model::Body::Workspace workspace(p.body);
  p.body.MassMatrix(straight, mass, workspace);
  p.body.TangentStiffness(straight, tension_N, Eigen::Vector3d::Zero(), stiffness);
  MatrixXd length(p.body.tendons(), p.body.dof());
  p.body.TendonLengthJacobian(straight, length);
  for (const SpoolSlide& s : p.slides)
    stiffness += s.tendon_stiffness_Npm * length.row(s.number - 1).transpose() * length.row(s.number - 1);
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> modes(stiffness, mass, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(1.0, modes.eigenvalues().maxCoeff()));
}

/// A period of the fastest motion takes six steps and more: 1, 2 or 5 times a power of ten, at most 2 ms.
double Timestep(const Parts& p) {
  const double most_s = std::min(2e-3, 1 / HighestRate(p));
  const double power_s = std::pow(10, std::floor(std::log10(most_s)));
  return power_s * (most_s >= 5 * power_s ? 5 : most_s >= 2 * power_s ? 2 : 1);
}

void AddHoles(Xml& xml, const Parts& p, int disk) {
  for (std::size_t j = 0; j < p.holes.size(); ++j) {
    if (static_cast<std::size_t>(disk) < p.holes[j].size()) {
      xml.Line("<site name=\"tendon{}_hole{}\" pos=\"{}\"/>", j + 1, disk,
               Text(p.holes[j][static_cast<std::size_t>(disk)]));
    }
  }
}

// A unit's bend t has the elastic energy k t^2 / 2, whatever its plane; springs in the hinges would be
// stiffer between their axes. A compressed spring between the centres of its disks has it up to t^6: their
// distance is l - 2 h (1 - cos(t / 2)) with the hinges at h from both, its rest length l + 6 h, its stiffness
// k / (3 h^2). Only a moment, which a rest bend needs, is the hinges': of soft springs far from their rest.
constexpr double kHingeShare = 0.01;

double HingeShare(const Unit& unit) { return unit.rest_rad.norm() > 0 ? kHingeShare : 0; }

void AddHinge(Xml& xml, const Unit& unit, const Hinge& hinge) {
  const double share = HingeShare(unit);
  const std::string spring =
      share > 0 ? fmt::format("stiffness=\"{:.10g}\" springref=\"{:.10g}\" ", 2 * share * unit.stiffness_Nm,
                              unit.rest_rad[hinge.direction] / (2 * share))
                : std::string();
  xml.Line("<joint name=\"unit{}_{}\" axis=\"{}\" pos=\"0 0 {:.10g}\" {}damping=\"{:.10g}\"/>", unit.number,
           hinge.name, hinge.axis, Along(unit, hinge) - unit.length_m, spring, 2 * unit.damping_Nms);
}

void AddSpring(Xml& xml, const Unit& unit) {
  const double hinge_m = HingePlace(unit) * unit.length_m;
  xml.Open(
      "<spatial name=\"unit{}\" stiffness=\"{:.10g}\" springlength=\"{:.10g}\" width=\"{:.6g}\" "
      "rgba=\"0.2 0.2 0.2 1\">",
      unit.number, (1 - HingeShare(unit)) * unit.stiffness_Nm / (3 * hinge_m * hinge_m),
      unit.length_m + 6 * hinge_m, unit.core_radius_m);
  xml.Line("<site site=\"disk{}_centre\"/>", unit.number - 1);
  xml.Line("<site site=\"disk{}_centre\"/>", unit.number);
  xml.Close("spatial");
}

void OpenDisk(Xml& xml, const Parts& p, const Unit& unit) {
  xml.Open("<body name=\"disk{}\" pos=\"0 0 {:.10g}\">", unit.number, unit.length_m);
  for (const Hinge& hinge : kHinges) AddHinge(xml, unit, hinge);
  xml.Line("<inertial pos=\"0 0 0\" mass=\"{0:.10g}\" diaginertia=\"{1:.10g} {1:.10g} {2:.10g}\"/>",
           unit.mass_kg, unit.inertia_xx_kgm2, unit.inertia_zz_kgm2);
  xml.Line("<geom type=\"cylinder\" size=\"{:.6g} {:.6g}\"/>", DrawnDisk_m(p.robot.body), unit.length_m / 20);
  xml.Line("<site name=\"disk{}_centre\"/>", unit.number);
  AddHoles(xml, p, unit.number);
}

void AddWorld(Xml& xml, const Parts& p) {
  xml.Open("<worldbody>");
  xml.Line("<site name=\"disk0_centre\"/>");
  AddHoles(xml, p, 0);
  for (const SpoolSlide& s : p.slides)
    AddSpoolBody(xml, s, p.holes[static_cast<std::size_t>(s.number - 1)].front());
  for (const Unit& unit : p.units) OpenDisk(xml, p, unit);
  xml.Line("<site name=\"tip\"/>");
  for (std::size_t i = 0; i < p.units.size(); ++i) xml.Close("body");
  xml.Close("worldbody");
}

void AddThroughHoles(Xml& xml, const Parts& p, std::size_t tendon) {
  for (std::size_t i = 0; i < p.holes[tendon].size(); ++i)
    xml.Line("<site site=\"tendon{}_hole{}\"/>", tendon + 1, i);
  xml.Close("spatial");
}

/// With motors a tendon is an elastic one from the spool on, and a path through the holes that the pulleys'
/// friction acts on.
void AddTendons(Xml& xml, const Parts& p) {
  xml.Open("<tendon>");
  for (std::size_t j = 0; j < p.holes.size(); ++j) {
    if (p.slides.empty()) {
      xml.Open("<spatial name=\"tendon{}\">", j + 1);
      AddThroughHoles(xml, p, j);
      continue;
    }
    const SpoolSlide& s = p.slides[j];
    xml.Open(
        "<spatial name=\"tendon{}\" stiffness=\"{:.10g}\" damping=\"{:.10g}\" springlength=\"0 {:.12g}\">",
        j + 1, s.tendon_stiffness_Npm, s.tendon_damping_Nspm, s.slack_length_m);
    xml.Line("<site site=\"tendon{}_spool\"/>", j + 1);
    AddThroughHoles(xml, p, j);
    xml.Open("<spatial name=\"tendon{}_path\" frictionloss=\"{:.10g}\">", j + 1, s.path_friction_N);
    AddThroughHoles(xml, p, j);
  }
  for (const Unit& unit : p.units) AddSpring(xml, unit);
  xml.Close("tendon");
}

void AddTies(Xml& xml, const Parts& p) {
  xml.Open("<equality>");
  for (const Unit& unit : p.units) {
    for (const Hinge& hinge : kHinges) {
      if (hinge.follows)
        xml.Line("<joint joint1=\"unit{0}_{1}\" joint2=\"unit{0}_{2}\"/>", unit.number, hinge.name,
                 hinge.follows);
    }
  }
  xml.Close("equality");
}

void AddActuators(Xml& xml, const Parts& p) {
  xml.Open("<actuator>");
  for (const SpoolSlide& s : p.slides) AddMotor(xml, s);
  if (p.slides.empty()) {
    for (std::size_t j = 0; j < p.holes.size(); ++j)
      xml.Line("<motor name=\"tension{0}\" tendon=\"tendon{0}\" gear=\"-1\" ctrlrange=\"0 {1:.10g}\"/>",
               j + 1, p.robot.limits.max_tension_base_N);
  }
  if (p.tip_force()) {
    xml.Line(
        "<general name=\"tip_force\" site=\"tip\" refsite=\"disk0_centre\" gear=\"{} 0 0 0\" gainprm=\"0\" "
        "biastype=\"affine\" biasprm=\"1 0 0\"/>",
        Text(p.robot.body.tip_force_W_N));
  }
  xml.Close("actuator");
}

void AddSensors(Xml& xml, const Parts& p) {
  xml.Open("<sensor>");
  xml.Line("<framepos name=\"tip_position\" objtype=\"site\" objname=\"tip\"/>");
  xml.Line("<framequat name=\"tip_orientation\" objtype=\"site\" objname=\"tip\"/>");
  for (std::size_t j = 1; j <= p.holes.size(); ++j)
    xml.Line("<tendonpos name=\"tendon{0}_length\" tendon=\"tendon{0}{1}\"/>", j,
             p.slides.empty() ? "" : "_path");
  for (const SpoolSlide& s : p.slides)
    xml.Line("<jointpos name=\"spool{0}_travel\" joint=\"spool{0}\"/>", s.number);
  xml.Close("sensor");
}

/// Straight, every tendon at its rest tension.
void AddKeyframe(Xml& xml, const Parts& p) {
  std::vector<double> controls, states;
  for (const SpoolSlide& s : p.slides) {
    controls.push_back(s.holding_torque_Nm);
    if (s.lag_s > 0) states.push_back(s.holding_torque_Nm);
  }
  const TendonVector rest_N = model::RestTensions_N(p.robot);
  if (p.slides.empty()) controls.assign(rest_N.begin(), rest_N.end());
  if (p.tip_force()) controls.push_back(0);
  const std::string act = states.empty() ? "" : fmt::format(" act=\"{:.10g}\"", fmt::join(states, " "));
  xml.Open("<keyframe>");
  xml.Line("<key name=\"pretension\" ctrl=\"{:.10g}\"{}/>", fmt::join(controls, " "), act);
  xml.Close("keyframe");
}

std::vector<std::string> LeftOut(const Parts& p, double friction_at_N) {
  std::vector<std::string> lines = {"Limits of bend and tension: only the controls have ranges."};
  std::vector<std::string> more;
  if (!p.slides.empty()) {
    more = LeftOutOfMotors(p.slides, friction_at_N);
  } else if (p.robot.actuation) {
    more = {"Motors, gears, spools, elastic tendons and pulleys: the controls are tensions at the base."};
  }
  lines.insert(lines.end(), more.begin(), more.end());
  for (std::string& line : LeftOutOfBoth(p.robot)) lines.push_back(std::move(line));
  return lines;
}

void AddOptions(Xml& xml, const Parts& p) {
  xml.Line("<compiler angle=\"radian\" autolimits=\"true\" inertiafromgeom=\"false\"/>");
  xml.Open(
      "<option timestep=\"{:.10g}\" gravity=\"{}\" integrator=\"implicitfast\" iterations=\"50\" "
      "tolerance=\"1e-10\">",
      p.timestep_s, Text(p.robot.body.gravity_W_mps2));
  xml.Line("<flag contact=\"disable\"/>");
  xml.Close("option");
  xml.Open("<default>");
  xml.Line("<geom contype=\"0\" conaffinity=\"0\" rgba=\"0.6 0.6 0.65 1\"/>");
  xml.Line("<site size=\"0.0005\"/>");
  // As stiff as MuJoCo allows: tied hinges differ by some 1e-6 rad; softer friction would not hold disks this
  // light.
  for (const auto& [element, of] : {std::pair{"equality", ""}, {"joint", "friction"}, {"tendon", "friction"}})
    xml.Line("<{0} solref{1}=\"{2:.10g} 1\" solimp{1}=\"0.9999 0.9999 0.001\"/>", element, of,
             2 * p.timestep_s);
  xml.Close("default");
}

void Require(double value, double least, double most, const char* what) {
  if (!(value >= least && value <= most))
    throw std::invalid_argument(fmt::format("{} is {:g}; accepted: {:g} to {:g}", what, value, least, most));
}

Parts PartsOf(const RobotParameters& robot, const MjcfOptions& options, double friction_at_N) {
  const bool motors = options.actuators ? *options.actuators == Actuators::kMotors
                                        : robot.actuation.has_value() && robot.actuation->pairs.empty();
  if (motors && !robot.actuation)
    throw std::invalid_argument("robot '" + robot.name +
                                "' has no actuation; accepted: tensions as controls");
  if (motors && !robot.actuation->pairs.empty())
    throw std::invalid_argument("robot '" + robot.name +
                                "' has antagonistic pairs, whose common spools are not exported; accepted: "
                                "tensions as controls (--actuators tensions)");
  Parts p{robot, model::Body(robot.body), {}, {}, {}, 0};
  p.units = UnitsOf(robot, p.body);
  VectorXd straight_m(p.body.tendons());
  p.body.TendonLengths(VectorXd::Zero(p.body.dof()), straight_m);
  for (int j = 0; j < p.body.tendons(); ++j) p.holes.push_back(HolesOf(p.body, j));
  if (motors) p.slides = SpoolSlides(robot, friction_at_N, {straight_m.begin(), straight_m.end()});
  p.timestep_s = options.timestep_s.value_or(Timestep(p));
  return p;
}

}  // namespace

Actuators ActuatorsOf(const std::string& word) {
  if (word == "tensions") return Actuators::kTensions;
  if (word == "motors") return Actuators::kMotors;
  throw std::invalid_argument("actuators are '" + word + "'; accepted: tensions, motors");
}

Exported Mjcf(const RobotParameters& robot, const MjcfOptions& options) {
  const double friction_at_N = options.friction_at_N.value_or(robot.limits.min_tension_N);
  Require(friction_at_N, 0, 1e4, "friction_at [N]");
  if (options.timestep_s) Require(*options.timestep_s, 1e-7, 0.1, "timestep [s]");
  const Parts p = PartsOf(robot, options, friction_at_N);
  Exported exported{.text = {}, .left_out = LeftOut(p, friction_at_N)};
  Xml xml;
  xml.Comment(Heading(robot,
                      p.slides.empty()
                          ? "Controls: tension1, ... at the base [N], pulling positive."
                          : "Controls: motor1, ..., torque at the motor shaft [N m], pulling positive.",
                      exported.left_out));
  xml.Open("<mujoco model=\"{}\">", robot.name);
  AddOptions(xml, p);
  AddWorld(xml, p);
  AddTendons(xml, p);
  AddTies(xml, p);
  AddActuators(xml, p);
  AddSensors(xml, p);
  AddKeyframe(xml, p);
  xml.Close("mujoco");
  exported.text = std::move(xml).Text();
  return exported;
}

}  // namespace tendril::exchange
