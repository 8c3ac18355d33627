// The questions in their order. A name ends in the unit of its answer, as keys do.
#include <fmt/format.h>

#include <string>

#include "tendril/config/answer.h"
#include "tendril/first_robot/questions.h"

namespace tendril::first_robot {
namespace {

/// Asked at a terminal.
constexpr Item Usual(std::string_view name, std::string_view path, std::string_view meaning = {}) {
  return {.name = name, .path = path, .usual = true, .meaning = meaning};
}
/// Likewise, a value for each section.
constexpr Item PerSection(std::string_view name, std::string_view path, std::string_view meaning) {
  return {.name = name, .path = path, .usual = true, .per_section = true, .meaning = meaning};
}
/// Keeps its suggestion unless an answer is given.
constexpr Item Rarely(std::string_view name, std::string_view path, std::string_view meaning = {}) {
  return {.name = name, .path = path, .meaning = meaning};
}
/// A key of the daemon file.
constexpr Item OfDaemon(Item item) {
  item.daemon_file = true;
  return item;
}

constexpr Item kItems[] = {
    Usual("name", "name"),
    Usual("mount", "", "How the base is mounted: the robot standing up, hanging down, or level."),
    Usual("sections", "body.sections", "Number of sections."),
    PerSection("tendons", "body.sections[].tendons",
               "Number of tendons that end at a section's last disk, evenly around it."),
    PerSection("length_m", "body.sections[].unit_length_m", "Backbone length of a section."),
    PerSection("disks", "body.sections[].units", "Disks of a section, one at the end of each unit."),
    PerSection("hole_radius_m", "body.sections[].tendons[].radius_m",
               "Distance of the tendons' holes from the disk's centre."),
    PerSection("disk_diameter_m", "body.sections[].disk_diameter_m",
               "Diameter of the disks, taken as uniform and thin."),
    PerSection("mass_kg", "body.sections[].unit_mass_kg",
               "Mass of a section, all disks and backbone; or the mean density of the cylinder around it, "
               "as in '1100 kg/m3'."),
    PerSection("backbone_diameter_m", "body.sections[].core_radius_m", "Diameter of the backbone."),
    PerSection("material_Pa", "body.sections[].youngs_modulus_Pa",
               "Backbone's material: nitinol, steel, glass_fibre, carbon_fibre, peek, nylon; or its Young's "
               "modulus; or the measured bending stiffness E I, as in '0.0011 Nm2'."),
    Usual("torque_constant_NmpA", "actuation.motor.torque_constant_NmpA"),
    Usual("nominal_current_A", "actuation.motor.nominal_current_A"),
    Rarely("rotor_inertia_kgm2", "actuation.motor.rotor_inertia_kgm2"),
    Rarely("current_limit_A", "actuation.drive.current_limit_A"),
    Usual("encoder_counts_per_turn", "actuation.drive.encoder_counts_per_turn"),
    Usual("gear_ratio", "actuation.gear.ratio"),
    Rarely("gear_efficiency", "actuation.gear.efficiency"),
    Usual("spool_radius_m", "actuation.spool.radius_m"),
    Rarely("tendon_stiffness_Npm", "actuation.tendon.stiffness_Npm"),
    Rarely("free_length_m", "actuation.tendon.free_length_m"),
    Rarely("wrap_rad", "actuation.transmission.pulleys[].wrap_rad",
           "Angle over which guide pulleys turn a tendon between spool and base; 0: none."),
    Rarely("min_tension_N", "limits.min_tension_N"),
    Usual("max_tension_motor_N", "limits.max_tension_motor_N"),
    Usual("max_tension_base_N", "limits.max_tension_base_N"),
    Usual("load_cell", "actuation.load_cell.place"),
    Rarely("load_cell_gain_VpN", "actuation.load_cell.gain_VpN"),
    Usual("tracker_Hz", "actuation.tracker.rate_Hz",
          "Readings a second of an outside measurement of the tip's pose, or none."),
    Usual("max_bending_rad", "limits.max_bending_rad"),
    OfDaemon(
        Usual("nodes", "bus.nodes[].node_id", "CANopen nodes of the drives, in tendon order, with commas.")),
    OfDaemon(Rarely("interface", "bus.interface")),
    OfDaemon(Rarely("bitrate_bps", "bus.bitrate_bps")),
    OfDaemon(Usual("cycle_ns", "bus.cycle_ns")),
};

}  // namespace

std::span<const Item> Items() { return kItems; }

std::string Described(const Item& item) {
  std::string meaning(item.meaning);
  if (meaning.empty()) {
    const auto keys = item.daemon_file ? config::DaemonFileKeys() : config::RobotFileKeys();
    meaning = config::KeyAt(keys, std::string(item.path)).meaning;
  }
  if (meaning.ends_with('.')) meaning.pop_back();
  if (const std::string unit = config::UnitOfKey(item.name); !unit.empty())
    meaning += fmt::format(" [{}]", unit);
  return meaning;
}

}  // namespace tendril::first_robot
