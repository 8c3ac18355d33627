// Robot and daemon files as Python objects: what a program reads of them. Knows no equation.
#include <fmt/format.h>
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <Eigen/Core>
#include <string>
#include <vector>

#include "module.h"
#include "tendril/config/config.h"
#include "tendril/core/load_cell_place.h"
#include "tendril/exchange/robot_model.h"
#include "tendril/sim/effects.h"

namespace tendril::python {
namespace {

namespace nb = nanobind;
using Eigen::VectorXd;

/// One number a tendon, in tendon order.
template <class Get>
VectorXd EachRoute(const RobotParameters& robot, const Get& get) {
  std::vector<double> values;
  for (const SectionParameters& section : robot.body.sections) {
    for (const TendonRoute& route : section.tendons) values.push_back(get(route));
  }
  return Eigen::Map<const VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

template <class Get>
std::vector<int> EachSection(const RobotParameters& robot, const Get& get) {
  std::vector<int> values;
  for (const SectionParameters& section : robot.body.sections) values.push_back(get(section));
  return values;
}

VectorXd UnitLengths(const RobotParameters& robot) {
  VectorXd length_m(robot.body.units());
  Eigen::Index i = 0;
  for (const SectionParameters& section : robot.body.sections) {
    for (int n = 0; n < section.units; ++n) length_m[i++] = section.unit_length_m;
  }
  return length_m;
}

std::string CellPlace(const RobotParameters& robot) {
  const bool none = !robot.actuation || robot.actuation->tendons.empty();
  return std::string(
      LoadCellPlaceText(none ? LoadCellPlace::kNone : robot.actuation->tendons.front().load_cell.place));
}

std::string EffectText(const EffectSetting& effect) {
  std::string text = effect.name + " where=" + effect.where;
  for (const auto& [name, value] : effect.values) text += fmt::format(" {}={}", name, value);
  return text;
}

std::vector<std::string> Effects(const RobotParameters& robot) {
  std::vector<std::string> texts;
  for (const EffectSetting& effect : robot.effects) texts.push_back(EffectText(effect));
  return texts;
}

RobotParameters WithEffects(RobotParameters robot, const std::vector<std::string>& effects) {
  for (const std::string& text : effects) robot.effects.push_back(sim::ParseEffect(text, robot));
  sim::CheckEffects(robot);
  return robot;
}

std::string ToUrdf(const RobotParameters& robot) { return exchange::Urdf(sim::FoldEffects(robot)).text; }

std::string ToMjcf(const RobotParameters& robot, const std::optional<std::string>& actuators,
                   std::optional<double> friction_at_N, std::optional<double> timestep_s) {
  return exchange::Mjcf(sim::FoldEffects(robot),
                        {actuators ? std::optional(exchange::ActuatorsOf(*actuators)) : std::nullopt,
                         friction_at_N, timestep_s})
      .text;
}

std::string Repr(const RobotParameters& r) {
  return fmt::format("<Robot '{}': {} section(s), {} units, {} tendons, {:g} mm{}>", r.name,
                     r.body.sections.size(), r.body.units(), r.body.tendons(), 1e3 * r.body.length_m(),
                     r.actuation ? "" : ", body alone");
}

void AddRobotClass(nb::module_& m) {
  using R = const RobotParameters&;
  nb::class_<RobotParameters>(
      m, "Robot",
      "A robot as its file describes it, in SI units. The base frame is F_0 (world frame W): its origin is "
      "the centre of the\n"
      "base disk, the straight robot points along +z. Does not change once loaded.")
      .def_prop_ro(
          "name", [](R r) { return r.name; }, "Name in the file.")
      .def_prop_ro(
          "sections", [](R r) { return static_cast<int>(r.body.sections.size()); }, "Number of sections K.")
      .def_prop_ro(
          "units", [](R r) { return r.body.units(); }, "Number of units N, over all sections.")
      .def_prop_ro(
          "tendons", [](R r) { return r.body.tendons(); }, "Number of tendons M, over all sections.")
      .def_prop_ro(
          "section_units", [](R r) { return EachSection(r, [](auto& s) { return s.units; }); },
          "Units of each section, K.")
      .def_prop_ro(
          "section_tendons",
          [](R r) { return EachSection(r, [](auto& s) { return static_cast<int>(s.tendons.size()); }); },
          "Tendons that end with each section, K.")
      .def_prop_ro(
          "length", [](R r) { return r.body.length_m(); }, "Length of the backbone [m].")
      .def_prop_ro("unit_lengths", &UnitLengths, "Length of each unit [m], N.")
      .def_prop_ro(
          "tendon_angles", [](R r) { return EachRoute(r, [](auto& t) { return t.angle_rad; }); },
          "Angle of each tendon's holes about the disks' z [rad], M.")
      .def_prop_ro(
          "tendon_radii", [](R r) { return EachRoute(r, [](auto& t) { return t.radius_m; }); },
          "Distance of each tendon's holes from the disks' centre [m], M.")
      .def_prop_ro(
          "gravity", [](R r) { return Eigen::Vector3d(r.body.gravity_W_mps2); },
          "Gravity in the base frame [m/s^2], 3.")
      .def_prop_ro(
          "min_tension", [](R r) { return r.limits.min_tension_N; },
          "Least tension at the base [N]: limits.min_tension_N.")
      .def_prop_ro(
          "max_tension_base", [](R r) { return r.limits.max_tension_base_N; },
          "Largest tension at the base [N]: limits.max_tension_base_N.")
      .def_prop_ro(
          "max_tension_motor", [](R r) { return r.limits.max_tension_motor_N; },
          "Largest tension at the motor's side of the pulleys [N]: limits.max_tension_motor_N.")
      .def_prop_ro(
          "max_bending", [](R r) { return r.limits.max_bending_rad; },
          "Largest bend of a section [rad]: limits.max_bending_rad.")
      .def_prop_ro(
          "has_actuation", [](R r) { return r.actuation.has_value(); },
          "False for a body alone, without motors and drives: good for a model, not to be simulated or "
          "diagnosed.")
      .def_prop_ro(
          "has_tracker", [](R r) { return r.actuation && r.actuation->tracker; },
          "True where a tracker measures the tip.")
      .def_prop_ro("load_cell", &CellPlace, "Place of the load cells: 'none', 'motor_side' or 'robot_side'.")
      .def_prop_ro("effects", &Effects,
                   "Effects beyond the nominal model, each as `tendril gap explain` writes them.")
      .def("with_effects", &WithEffects, nb::arg("effects"),
           "A robot with these effects more, each as a text such as 'backlash where=tendon:2 rad=0.05'. "
           "Raises ValueError with\n"
           "what is accepted.")
      .def(
          "to_yaml", [](R r) { return config::ToYaml(r); },
          "The resolved file, with every value spelled out.")
      .def("to_mjcf", &ToMjcf, nb::kw_only(), nb::arg("actuators") = nb::none(),
           nb::arg("friction_at") = nb::none(), nb::arg("timestep") = nb::none(),
           "The robot for MuJoCo, as `tendril model export` writes it. actuators: 'tensions' at the base, or "
           "'motors', the default\n"
           "where the robot has them; friction_at: base tension [N] whose losses the constant friction has; "
           "timestep [s].")
      .def("to_urdf", &ToUrdf,
           "The kinematic chain with its inertias as URDF; joint angles: `Model.hinge_angles`.")
      .def("__repr__", &Repr);
}

void AddDaemonClass(nb::module_& m) {
  using D = const DaemonParameters&;
  nb::class_<DaemonParameters>(m, "Daemon", "A daemon's file: bus, controller, channels.")
      .def_prop_ro(
          "robot_file", [](D d) { return d.robot_file; }, "Path of the robot file it names.")
      .def_prop_ro(
          "cycle", [](D d) { return ToSeconds(d.bus.cycle_ns); }, "Time of a control cycle [s].")
      .def_prop_ro(
          "interface", [](D d) { return d.bus.interface; }, "CAN interface, for example 'can0'.")
      .def_prop_ro(
          "url", [](D d) { return d.lcm.url; }, "LCM address.")
      .def_prop_ro(
          "prefix", [](D d) { return d.lcm.channel_prefix; }, "Prefix of its LCM channels.")
      .def_prop_ro(
          "default_speed", [](D d) { return d.controller.trajectory.default_speed_radps; },
          "Bending speed of moves that name none [rad/s].")
      .def_prop_ro(
          "max_rate", [](D d) { return d.controller.trajectory.max_rate_radps; },
          "Largest bending speed of a section [rad/s].")
      .def(
          "to_yaml", [](D d) { return config::ToYaml(d); },
          "The resolved file, with every value spelled out.")
      .def("__repr__",
           [](D d) { return fmt::format("<Daemon on {}, robot file {}>", d.bus.interface, d.robot_file); });
}

}  // namespace

void AddRobot(nb::module_& m) {
  AddRobotClass(m);
  AddDaemonClass(m);
  m.def(
      "load_robot", [](const std::string& path) { return sim::LoadRobot(path); }, nb::arg("path"));
  m.def(
      "parse_robot",
      [](const std::string& yaml, const std::string& name) {
        RobotParameters robot = config::ParseRobot(yaml, name);
        sim::CheckEffects(robot);
        return robot;
      },
      nb::arg("yaml"), nb::arg("name"));
  m.def(
      "parse_daemon",
      [](const std::string& yaml, const std::string& name) { return config::ParseDaemon(yaml, name); },
      nb::arg("yaml"), nb::arg("name"));
  m.def(
      "load_daemon", [](const std::string& path) { return config::LoadDaemon(path); }, nb::arg("path"));
}

}  // namespace tendril::python
