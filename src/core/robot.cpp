#include "tendril/core/robot.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tendril {

double SectionParameters::UnitStiffness() const {
  const double r2 = core_radius_m * core_radius_m;
  return youngs_modulus_Pa * std::numbers::pi * r2 * r2 / 4 / unit_length_m;
}

double SectionParameters::UnitTorsionalStiffness() const {
  if (torsional_stiffness_Nm2) return *torsional_stiffness_Nm2 / unit_length_m;
  // G J = E / (2 (1 + nu)) * 2 I of a round rod.
  return UnitStiffness() / (1 + poissons_ratio.value());
}

double SectionParameters::UnitAxialStiffness() const {
  const double area_m2 = std::numbers::pi * core_radius_m * core_radius_m;
  return axial_stiffness_N.value_or(youngs_modulus_Pa * area_m2) * unit_length_m;
}

double SectionParameters::UnitShearStiffness() const {
  double sheared_N = 0;
  if (shear_stiffness_N) {
    sheared_N = *shear_stiffness_N;
  } else {
    // k = 6 (1 + nu) / (7 + 6 nu) of a round section (Cowper, 1966); G = E / (2 (1 + nu)).
    const double area_m2 = std::numbers::pi * core_radius_m * core_radius_m;
    sheared_N = 3 * youngs_modulus_Pa * area_m2 / (7 + 6 * poissons_ratio.value());
  }
  const double left_out = unit_length_m / (12 * UnitStiffness());  // l^2 / (12 EI)
  return unit_length_m / (1 / sheared_N + left_out);
}

double SectionParameters::MassAt(int unit_of_section) const {
  return EndsAtDisk(unit_of_section) ? unit_mass_kg + disk_mass_kg : unit_mass_kg;
}

double SectionParameters::InertiaXxAt(int unit_of_section) const {
  if (EndsAtDisk(unit_of_section)) return disk_inertia_xx_kgm2;
  return unit_mass_kg * (core_radius_m * core_radius_m / 4 + unit_length_m * unit_length_m / 12);
}

double SectionParameters::InertiaZzAt(int unit_of_section) const {
  if (EndsAtDisk(unit_of_section)) return disk_inertia_zz_kgm2;
  return unit_mass_kg * core_radius_m * core_radius_m / 2;
}

int BodyParameters::units() const {
  int n = 0;
  for (const auto& s : sections) n += s.units;
  return n;
}

int BodyParameters::disks() const {
  int n = 0;
  for (const auto& s : sections) n += s.units / s.units_per_disk;
  return n;
}

int BodyParameters::tendons() const {
  int n = 0;
  for (const auto& s : sections) n += static_cast<int>(s.tendons.size());
  return n;
}

double BodyParameters::length_m() const {
  double l = 0;
  for (const auto& s : sections) l += s.units * s.unit_length_m;
  return l;
}

double BodyParameters::largest_hole_m() const {
  double radius_m = 0;
  for (const SectionParameters& section : sections) {
    for (const TendonRoute& t : section.tendons)
      radius_m = std::max({radius_m, t.radius_m, t.end_radius_m.value_or(0)});
  }
  return radius_m;
}

double BodyParameters::mass_kg() const {
  double m = tip_payload_kg;
  for (const auto& s : sections) m += s.units * s.unit_mass_kg + s.units / s.units_per_disk * s.disk_mass_kg;
  return m;
}

bool BodyParameters::BendsOnly() const {
  return std::none_of(sections.begin(), sections.end(), [](const SectionParameters& s) {
    return s.torsion || s.extension || s.shear || s.units_per_disk != 1;
  });
}

bool BodyParameters::HasStraightRoutes() const {
  return std::all_of(sections.begin(), sections.end(), [](const SectionParameters& s) {
    return std::all_of(s.tendons.begin(), s.tendons.end(),
                       [](const TendonRoute& t) { return t.IsStraight(); });
  });
}

const TendonRoute& BodyParameters::RouteOf(int tendon) const {
  auto section = sections.begin();
  for (; tendon >= static_cast<int>(section->tendons.size()); ++section)
    tendon -= static_cast<int>(section->tendons.size());
  return section->tendons[static_cast<std::size_t>(tendon)];
}

Eigen::Vector3d BodyParameters::HoleOf(int tendon, double arc_m) const {
  const TendonRoute& route = RouteOf(tendon);
  double radius = route.radius_m;
  if (route.end_radius_m) {
    const double share = std::min(1.0, arc_m / ArcTo(EndDiskOf(tendon) - 1));
    radius += share * (*route.end_radius_m - route.radius_m);
  }
  const double angle = route.angle_rad + (twist_rad_per_m + route.turn_rad_per_m) * arc_m;
  return {radius * std::cos(angle), radius * std::sin(angle), 0};
}

int BodyParameters::EndDiskOf(int tendon) const {
  int before = 0;
  for (const SectionParameters& s : sections) {
    const int disks = s.units / s.units_per_disk, own = static_cast<int>(s.tendons.size());
    if (tendon < own) {
      const int ends_at = s.tendons[static_cast<std::size_t>(tendon)].ends_at_disk;
      return before + (ends_at > 0 ? ends_at : disks);
    }
    tendon -= own;
    before += disks;
  }
  return before;
}

double BodyParameters::ArcTo(int disk) const {
  double arc_m = 0;
  for (const SectionParameters& s : sections) {
    const int disks = std::min(disk + 1, s.units / s.units_per_disk);
    arc_m += disks * s.units_per_disk * s.unit_length_m;
    disk -= disks;
    if (disk < 0) break;
  }
  return arc_m;
}

UnitDeviation& BodyParameters::DeviationOf(int unit) {
  const auto at = std::lower_bound(unit_deviations.begin(), unit_deviations.end(), unit,
                                   [](const UnitDeviation& d, int number) { return d.unit < number; });
  if (at != unit_deviations.end() && at->unit == unit) return *at;
  return *unit_deviations.insert(at, {.unit = unit});
}

const TendonPair* ActuationParameters::PairOf(int tendon) const {
  const auto at = std::find_if(pairs.begin(), pairs.end(), [tendon](const TendonPair& pair) {
    return pair.first == tendon || pair.second == tendon;
  });
  return at == pairs.end() ? nullptr : &*at;
}

bool ActuationParameters::HasDrive(int tendon) const {
  const TendonPair* pair = PairOf(tendon);
  return pair == nullptr || pair->first == tendon;
}

int ActuationParameters::drives() const { return static_cast<int>(tendons.size() - pairs.size()); }

int ActuationParameters::DriveOf(int tendon) const {
  const TendonPair* pair = PairOf(tendon);
  const std::vector<int> driven = DrivenTendons();
  return static_cast<int>(std::find(driven.begin(), driven.end(), pair != nullptr ? pair->first : tendon) -
                          driven.begin());
}

std::vector<int> ActuationParameters::DrivenTendons() const {
  std::vector<int> driven;
  for (int j = 0; j < static_cast<int>(tendons.size()); ++j) {
    if (HasDrive(j)) driven.push_back(j);
  }
  return driven;
}

double RobotParameters::RestTension_N(int tendon) const {
  const TendonPair* pair = actuation ? actuation->PairOf(tendon) : nullptr;
  return pair != nullptr ? pair->pretension_N : limits.min_tension_N;
}

}  // namespace tendril
