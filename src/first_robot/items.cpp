// The questions in their order. A name ends in the unit of its answer, as keys do.
#include <fmt/format.h>

#include <string>

#include "tendril/config/answer.h"
#include "tendril/first_robot/questions.h"

namespace tendril::first_robot {
namespace {

constexpr Item kItems[] = {
    {.name = "name", .path = "name", .usual = true},
    {.name = "mount",
     .usual = true,
     .meaning = "How the base is mounted: the robot standing up, hanging down, or level."},
    {.name = "sections", .path = "body.sections", .usual = true, .meaning = "Number of sections."},
    {.name = "tendons",
     .path = "body.sections[].tendons",
     .usual = true,
     .per_section = true,
     .meaning = "Number of tendons that end at a section's last disk, evenly around it."},
    {.name = "length_m",
     .path = "body.sections[].unit_length_m",
     .usual = true,
     .per_section = true,
     .meaning = "Backbone length of a section."},
    {.name = "disks",
     .path = "body.sections[].units",
     .usual = true,
     .per_section = true,
     .meaning = "Disks of a section, one at the end of each unit."},
    {.name = "hole_radius_m",
     .path = "body.sections[].tendons[].radius_m",
     .usual = true,
     .per_section = true,
     .meaning = "Distance of the tendons' holes from the disk's centre."},
    {.name = "disk_diameter_m",
     .path = "body.sections[].disk_diameter_m",
     .usual = true,
     .per_section = true,
     .meaning = "Diameter of the disks, taken as uniform and thin."},
    {.name = "mass_kg",
     .path = "body.sections[].unit_mass_kg",
     .usual = true,
     .per_section = true,
     .meaning = "Mass of a section, all disks and backbone; or the mean density of the cylinder around it, "
                "as in '1100 kg/m3'."},
    {.name = "backbone_diameter_m",
     .path = "body.sections[].core_radius_m",
     .usual = true,
     .per_section = true,
     .meaning = "Diameter of the backbone."},
    {.name = "material_Pa",
     .path = "body.sections[].youngs_modulus_Pa",
     .usual = true,
     .per_section = true,
     .meaning = "Backbone's material: nitinol, steel, glass_fibre, carbon_fibre, peek, nylon; or its Young's "
                "modulus; or the measured bending stiffness E I, as in '0.0011 Nm2'."},
    {.name = "torque_constant_NmpA", .path = "actuation.motor.torque_constant_NmpA", .usual = true},
    {.name = "nominal_current_A", .path = "actuation.motor.nominal_current_A", .usual = true},
    {.name = "rotor_inertia_kgm2", .path = "actuation.motor.rotor_inertia_kgm2"},
    {.name = "current_limit_A", .path = "actuation.drive.current_limit_A"},
    {.name = "encoder_counts_per_turn", .path = "actuation.drive.encoder_counts_per_turn", .usual = true},
    {.name = "gear_ratio", .path = "actuation.gear.ratio", .usual = true},
    {.name = "gear_efficiency", .path = "actuation.gear.efficiency"},
    {.name = "spool_radius_m", .path = "actuation.spool.radius_m", .usual = true},
    {.name = "tendon_stiffness_Npm", .path = "actuation.tendon.stiffness_Npm"},
    {.name = "free_length_m", .path = "actuation.tendon.free_length_m"},
    {.name = "wrap_rad",
     .path = "actuation.transmission.pulleys[].wrap_rad",
     .meaning = "Angle over which guide pulleys turn a tendon between spool and base; 0: none."},
    {.name = "min_tension_N", .path = "limits.min_tension_N"},
    {.name = "max_tension_motor_N", .path = "limits.max_tension_motor_N", .usual = true},
    {.name = "max_tension_base_N", .path = "limits.max_tension_base_N", .usual = true},
    {.name = "load_cell", .path = "actuation.load_cell.place", .usual = true},
    {.name = "load_cell_gain_VpN", .path = "actuation.load_cell.gain_VpN"},
    {.name = "tracker_Hz",
     .path = "actuation.tracker.rate_Hz",
     .usual = true,
     .meaning = "Readings a second of an outside measurement of the tip's pose, or none."},
    {.name = "max_bending_rad", .path = "limits.max_bending_rad", .usual = true},
    {.name = "nodes",
     .path = "bus.nodes[].node_id",
     .daemon_file = true,
     .usual = true,
     .meaning = "CANopen nodes of the drives, in tendon order, with commas."},
    {.name = "interface", .path = "bus.interface", .daemon_file = true},
    {.name = "bitrate_bps", .path = "bus.bitrate_bps", .daemon_file = true},
    {.name = "cycle_ns", .path = "bus.cycle_ns", .daemon_file = true, .usual = true},
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
