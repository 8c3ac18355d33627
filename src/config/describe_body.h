// The robot file's block body, key by key: sections, tendon routes, and what an ideal robot does not need.
// Used as describe_robot.h.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <string_view>
#include <vector>

#include "describe_optional.h"
#include "describe_strains.h"
#include "lister.h"
#include "reader.h"
#include "tendril/core/limits.h"
#include "tendril/core/robot.h"
#include "text_rules.h"

namespace tendril::config {

template <class Io>
void Describe(Io& io, TendonRoute& p) {
  io.Number("angle_rad", p.angle_rad, {-6.3, 6.3},
            "Where the hole lies about the disk's z axis, from +x towards +y.");
  io.Number("radius_m", p.radius_m, {1e-4, 0.5},
            "Distance of the hole from the disk's centre; more than core_radius_m.");
  NumberOrNone(io, "end_radius_m", p.end_radius_m, {1e-4, 0.5}, "radius_m everywhere",
               "The same at the tendon's last disk; radius_m is then that at the base, and it changes evenly "
               "between.");
  OptionalNumber(
      io, "turn_rad_per_m", p.turn_rad_per_m, 0, {-1000, 1000},
      "Turn of the hole about the z axis along the backbone: a helix. Tendons of different turns cross.");
  if (GivenOrOther(io, "ends_at_disk", p.ends_at_disk, 0, std::string_view("the section's last")))
    io.Integer("ends_at_disk", p.ends_at_disk, {1, kMaxUnits},
               "Disk of the section at which the tendon ends, from 1.");
}

template <class Io>
void Describe(Io& io, SectionParameters& p) {
  io.Integer("units", p.units, {1, kMaxUnits},
             "Equal units of constant strain, one disk each unless units_per_disk says otherwise.");
  DescribeSpacing(io, p);
  io.Number("unit_length_m", p.unit_length_m, {1e-4, 1}, "Backbone length of one unit.");
  io.Number("unit_mass_kg", p.unit_mass_kg, {1e-7, 10}, "Mass of one unit, lumped at its end.");
  OptionalNumber(io, "disk_mass_kg", p.disk_mass_kg, 0, {0, 10},
                 "Mass of each disk, beside that of the units.");
  double disk_diameter_m = 0;
  constexpr Range kDiameter{1e-4, 1};
  constexpr std::string_view kDiameterMeaning =
      "Diameter of a uniform thin disk, in place of both inertias: I_xx = m d²/16, I_zz = m d²/8 with m = "
      "disk_mass_kg, or unit_mass_kg without it.";
  if constexpr (Io::kListing) {
    io.MayBeLeftOut("both inertias");
    io.InsteadOf({"disk_inertia_xx_kgm2", "disk_inertia_zz_kgm2"});
    io.Number("disk_diameter_m", disk_diameter_m, kDiameter, kDiameterMeaning);
    io.MayBeLeftOut("disk_diameter_m");
  }
  if constexpr (Io::kReading) {
    // Either both inertias, or the diameter of a uniform thin disk: I_xx = m d^2 / 16, I_zz = m d^2 / 8.
    if (io.Has("disk_diameter_m")) {
      for (const char* other : {"disk_inertia_xx_kgm2", "disk_inertia_zz_kgm2"}) {
        io.Check(
            !io.Has(other), other,
            "given beside disk_diameter_m; accepted: either disk_diameter_m, or disk_inertia_xx_kgm2 and "
            "disk_inertia_zz_kgm2; remove one of the two");
      }
      io.Number("disk_diameter_m", disk_diameter_m, kDiameter, kDiameterMeaning);
      const double disk_kg = p.disk_mass_kg > 0 ? p.disk_mass_kg : p.unit_mass_kg;
      p.disk_inertia_xx_kgm2 = disk_kg * disk_diameter_m * disk_diameter_m / 16;
      p.disk_inertia_zz_kgm2 = disk_kg * disk_diameter_m * disk_diameter_m / 8;
      io.PassUncertainty("disk_diameter_m", disk_diameter_m, 2,
                         {"disk_inertia_xx_kgm2", "disk_inertia_zz_kgm2"});
    } else {
      io.Allow("disk_diameter_m");
    }
  }
  if (disk_diameter_m == 0) {
    io.Number("disk_inertia_xx_kgm2", p.disk_inertia_xx_kgm2, {1e-16, 1},
              "Moment of inertia of the disk about its x and y axes.");
    if constexpr (Io::kListing) io.MayBeLeftOut("disk_diameter_m");
    io.Number("disk_inertia_zz_kgm2", p.disk_inertia_zz_kgm2, {1e-16, 1},
              "Moment of inertia of the disk about its z axis; at most twice disk_inertia_xx_kgm2.");
    io.Check(
        p.disk_inertia_zz_kgm2 <= 2 * p.disk_inertia_xx_kgm2 * (1 + 1e-9), "disk_inertia_zz_kgm2",
        fmt::format(
            "{} is more than any body with this disk_inertia_xx_kgm2 can have; accepted: up to {} kg·m²; "
            "correct one of the two",
            p.disk_inertia_zz_kgm2, 2 * p.disk_inertia_xx_kgm2));
  }
  io.Number("youngs_modulus_Pa", p.youngs_modulus_Pa, {1e6, 1e12}, "Young's modulus E of the backbone.");
  io.Number("core_radius_m", p.core_radius_m, {1e-5, 0.05},
            "Radius r of the backbone; a unit's bending stiffness is E π r⁴ / (4 unit_length_m).");
  io.Number("bending_damping_Nms", p.bending_damping_Nms, {0, 1000},
            "Viscous damping of each unit, on the rate of its two bending angles.");
  DescribeStrains(io, p);
  io.List("tendons", p.tendons, {1, kMaxTendons},
          "The tendons that end in the section, at its last disk unless ends_at_disk says otherwise.");
  if constexpr (Io::kReading) {
    for (std::size_t j = 0; j < p.tendons.size(); ++j) {
      const TendonRoute& t = p.tendons[j];
      const double inner_m = std::min(t.radius_m, t.end_radius_m.value_or(t.radius_m)),
                   outer_m = std::max(t.radius_m, t.end_radius_m.value_or(0));
      io.Check(inner_m > p.core_radius_m, "core_radius_m",
               fmt::format(
                   "{} does not leave room for the hole of tendon {} at {} m; accepted: less than {} m; make "
                   "the backbone thinner or move the hole out",
                   p.core_radius_m, j + 1, inner_m, inner_m));
      io.Check(
          disk_diameter_m == 0 || disk_diameter_m > 2 * outer_m, "disk_diameter_m",
          fmt::format(
              "{} is too small for the hole of tendon {} at {} m; accepted: above {} m; correct one of the "
              "two",
              disk_diameter_m, j + 1, outer_m, 2 * outer_m));
      const int disks = p.units_per_disk > 0 ? p.units / p.units_per_disk : 0;
      io.Check(t.ends_at_disk <= disks, "tendons",
               fmt::format(
                   "tendon {} ends at disk {} of a section with {}; accepted: 1 .. {}; correct ends_at_disk",
                   j + 1, t.ends_at_disk, disks, disks));
    }
  }
}

template <class Io>
void Describe(Io& io, UnitDeviation& p) {
  io.Integer("unit", p.unit, {1, kMaxUnits}, "The unit, counted over all sections from the base.");
  OptionalNumber(io, "stiffness_scale", p.stiffness_scale, 1, {0.01, 100},
                 "Factor on the unit's bending stiffness.");
  OptionalNumber(io, "rest_u_rad", p.rest_u_rad, 0, {-3, 3},
                 "Bend about x in which the unit's backbone is free of stress.");
  OptionalNumber(io, "rest_v_rad", p.rest_v_rad, 0, {-3, 3},
                 "Bend about y in which the unit's backbone is free of stress.");
}

template <class Io>
void DescribeVector(Io& io, std::string_view key, Eigen::Vector3d& value, Range range,
                    std::string_view meaning) {
  std::vector<double> numbers(value.data(), value.data() + 3);
  io.Numbers(key, numbers, range, {3, 3}, meaning);
  if (numbers.size() == 3) value = {numbers[0], numbers[1], numbers[2]};
}

/// At most one entry per existing unit; sorted by unit.
inline void CheckDeviations(Reader& io, BodyParameters& p) {
  std::set<int> seen;
  for (const UnitDeviation& d : p.unit_deviations) {
    io.Check(d.unit <= p.units(), "unit_deviations",
             fmt::format("unit {} does not exist; accepted: 1 .. {}; correct it", d.unit, p.units()));
    io.Check(seen.insert(d.unit).second, "unit_deviations",
             fmt::format("unit {} twice; accepted: at most one entry a unit; join the two", d.unit));
  }
  std::vector<std::size_t> order(p.unit_deviations.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return p.unit_deviations[a].unit < p.unit_deviations[b].unit;
  });
  io.ReorderUncertainty("unit_deviations", order);
  std::sort(p.unit_deviations.begin(), p.unit_deviations.end(),
            [](const UnitDeviation& a, const UnitDeviation& b) { return a.unit < b.unit; });
}

/// Keys of the body that an ideal robot does not need.
template <class Io>
void DescribeDeviations(Io& io, BodyParameters& p) {
  OptionalNumber(io, "tip_payload_kg", p.tip_payload_kg, 0, {0, 1000},
                 "Point mass at the centre of the last disk.");
  OptionalNumber(io, "twist_rad_per_m", p.twist_rad_per_m, 0, {-1000, 1000},
                 "Turn of the disks' holes about z for each metre of backbone.");
  const auto tip_force = [&] {
    DescribeVector(io, "tip_force_W_N", p.tip_force_W_N, {-100000, 100000},
                   "Constant force at the centre of the last disk, in the base frame F_0.");
  };
  const auto unit_deviations = [&] {
    io.List("unit_deviations", p.unit_deviations, {0, kMaxUnits},
            "What single units have that their section's numbers do not say; one entry a unit at most.");
  };
  if constexpr (Io::kReading) {
    p.tip_force_W_N.setZero();
    p.unit_deviations.clear();
    for (const char* key : {"tip_force_W_N", "unit_deviations"}) io.Allow(key);
    if (io.Has("tip_force_W_N")) tip_force();
    if (io.Has("unit_deviations")) unit_deviations();
    CheckDeviations(io, p);
  } else if constexpr (Io::kListing) {
    io.MayBeLeftOut("none");
    tip_force();
    io.MayBeLeftOut("none");
    unit_deviations();
  } else {
    if (!p.tip_force_W_N.isZero(0)) tip_force();
    if (!p.unit_deviations.empty()) unit_deviations();
  }
}

template <class Io>
void Describe(Io& io, BodyParameters& p) {
  DescribeVector(io, "gravity_W_mps2", p.gravity_W_mps2, {-100, 100},
                 "Gravity in the base frame F_0; the straight robot points along +z.");
  io.List("sections", p.sections, {1, kMaxSections},
          "The sections, base first; at most 64 units and 16 tendons over all.");
  DescribeDeviations(io, p);
  if constexpr (Io::kReading) {
    io.Check(p.units() <= kMaxUnits, "sections",
             fmt::format("{} units in all; accepted: up to {} over all sections; use fewer, longer units",
                         p.units(), kMaxUnits));
    io.Check(p.tendons() <= kMaxTendons, "sections",
             fmt::format("{} tendons in all; accepted: up to {} over all sections; remove some", p.tendons(),
                         kMaxTendons));
    // All tendons pass the base section's disks, so no two may share a hole there.
    std::vector<Eigen::Vector2d> holes;
    for (const SectionParameters& section : p.sections) {
      for (const TendonRoute& t : section.tendons) {
        const Eigen::Vector2d hole{t.radius_m * std::cos(t.angle_rad), t.radius_m * std::sin(t.angle_rad)};
        for (std::size_t k = 0; k < holes.size(); ++k) {
          io.Check(
              (holes[k] - hole).norm() > 1e-5, "sections",
              fmt::format(
                  "tendons {} and {} pass the base section's disks through the same hole; accepted: holes "
                  "more than 1e-05 m apart; turn one of them",
                  k + 1, holes.size() + 1));
        }
        holes.push_back(hole);
      }
    }
  }
}

}  // namespace tendril::config
