// The keys of a section whose units do more than bend: which strains, how stiff, how damped, at rest where.
// Used as describe_robot.h.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "describe_optional.h"
#include "lister.h"
#include "reader.h"
#include "tendril/core/limits.h"
#include "tendril/core/robot.h"

namespace tendril::config {

/// A number that may be left out; `shown`: what applies then.
template <class Io>
void NumberOrNone(Io& io, std::string_view key, std::optional<double>& value, Range range,
                  std::string_view shown, std::string_view meaning) {
  if (GivenOrOther(io, key, value, std::optional<double>(), shown)) {
    double number = value.value_or(0);
    io.Number(key, number, range, meaning);
    if constexpr (Io::kReading) value = number;
  }
}

/// Units within a disk spacing and the mass of its disk. After units and before unit_length_m.
template <class Io>
void DescribeSpacing(Io& io, SectionParameters& p) {
  if (GivenOrOther(io, "units_per_disk", p.units_per_disk, 1, 1.))
    io.Integer("units_per_disk", p.units_per_disk, {1, kMaxUnits},
               "Units between neighbouring disks, over which tendons run straight; it divides units.");
  if constexpr (Io::kReading) {
    if (p.units_per_disk < 1 || p.units % p.units_per_disk == 0) return;
    io.Check(
        false, "units_per_disk",
        fmt::format("{} does not divide the section's {} units, which end at a disk; accepted: a divisor of "
                    "units; correct one of the two",
                    p.units_per_disk, p.units));
  }
}

template <class Io>
void DescribeStrainList(Io& io, SectionParameters& p) {
  std::vector<std::string> strains{"bending"};
  if constexpr (!Io::kReading) {
    if (p.torsion) strains.emplace_back("torsion");
    if (p.extension) strains.emplace_back("extension");
    if (p.shear) strains.emplace_back("shear");
  }
  const std::vector<std::string> bending{"bending"};
  if (GivenOrOther(io, "strains", strains, bending, std::string_view("bending")))
    io.Words(
        "strains", strains, {"bending", "torsion", "extension", "shear"},
        "What the section's units do: bend, and if named twist about the backbone, stretch along it and move "
        "sideways.");
  if constexpr (Io::kReading) {
    const auto has = [&](std::string_view name) {
      return std::find(strains.begin(), strains.end(), name) != strains.end();
    };
    io.Check(has("bending"), "strains",
             "without bending; accepted: bending, and torsion, extension or shear beside it; add it");
    p.torsion = has("torsion");
    p.extension = has("extension");
    p.shear = has("shear");
  }
}

/// Refuses a key of a strain that is switched off: it would be ignored.
template <class Io>
void RequireStrain(Io& io, bool on, std::string_view key, std::string_view strain) {
  if constexpr (Io::kReading) {
    io.Check(on || !io.Has(key), key,
             fmt::format(
                 "given, but the section has no {0}; accepted: only where strains names {0}; remove it, or "
                 "add {0} to strains",
                 strain));
  }
}

/// After core_radius_m.
template <class Io>
void DescribeStrains(Io& io, SectionParameters& p) {
  DescribeStrainList(io, p);
  RequireStrain(io, p.torsion || p.shear, "poissons_ratio", "torsion or shear");
  for (const char* key : {"torsional_stiffness_Nm2", "torsional_damping_Nms", "rest_torsion_rad_per_m"})
    RequireStrain(io, p.torsion, key, "torsion");
  for (const char* key : {"axial_stiffness_N", "axial_damping_Nspm", "rest_extension"})
    RequireStrain(io, p.extension, key, "extension");
  for (const char* key : {"shear_stiffness_N", "shear_damping_Nspm"})
    RequireStrain(io, p.shear, key, "shear");
  NumberOrNone(io, "poissons_ratio", p.poissons_ratio, {-0.99, 0.5},
               "needed by torsion without torsional_stiffness_Nm2 and by shear without shear_stiffness_N",
               "Poisson's ratio of the backbone, for stiffnesses of a round rod: torsional E π r⁴ / (4 (1 + "
               "ν)), of shear "
               "3 E π r² / (7 + 6 ν).");
  NumberOrNone(io, "torsional_stiffness_Nm2", p.torsional_stiffness_Nm2, {1e-12, 1e6}, "that of a round rod",
               "Torsional stiffness G J of the backbone: moment per twist in rad/m.");
  NumberOrNone(io, "axial_stiffness_N", p.axial_stiffness_N, {1e-3, 1e9}, "that of a round rod, E π r²",
               "Axial stiffness E A of the backbone: force per extension.");
  NumberOrNone(io, "shear_stiffness_N", p.shear_stiffness_N, {1e-3, 1e9}, "that of a round rod",
               "Shear stiffness k G A of the backbone: sideways force per angle of shear. A unit moves "
               "sideways also by "
               "the bending that one constant bend leaves out, F l³ / (12 E I).");
  OptionalNumber(io, "torsional_damping_Nms", p.torsional_damping_Nms, 0, {0, 1000},
                 "Viscous damping of each unit, on the rate of its torsion.");
  OptionalNumber(io, "axial_damping_Nspm", p.axial_damping_Nspm, 0, {0, 1e6},
                 "Viscous damping of each unit, on the rate of its change of length.");
  OptionalNumber(io, "shear_damping_Nspm", p.shear_damping_Nspm, 0, {0, 1e6},
                 "Viscous damping of each unit, on the rate of its sideways motion.");
  OptionalNumber(io, "rest_torsion_rad_per_m", p.rest_torsion_rad_per_m, 0, {-1000, 1000},
                 "Twist in which the backbone is free of stress.");
  OptionalNumber(io, "rest_extension", p.rest_extension, 0, {-0.5, 1},
                 "Extension in which the backbone is free of stress, as a share of its length.");
  if constexpr (Io::kReading) {
    io.Check(!p.torsion || p.poissons_ratio || p.torsional_stiffness_Nm2, "strains",
             "torsion without its stiffness; accepted: torsion beside poissons_ratio (-0.99 .. 0.5) or "
             "torsional_stiffness_Nm2 (1e-12 .. 1e+06 N·m²); add one of the two");
    io.Check(!p.shear || p.poissons_ratio || p.shear_stiffness_N, "strains",
             "shear without its stiffness; accepted: shear beside poissons_ratio (-0.99 .. 0.5) or "
             "shear_stiffness_N (0.001 .. 1e+09 N); add one of the two");
    const bool used = (p.torsion && !p.torsional_stiffness_Nm2) || (p.shear && !p.shear_stiffness_N);
    io.Check(!p.poissons_ratio || used, "poissons_ratio",
             fmt::format("given beside {}; accepted: one of the two; remove the other",
                         !p.torsion ? "shear_stiffness_N"
                         : !p.shear ? "torsional_stiffness_Nm2"
                                    : "torsional_stiffness_Nm2 and shear_stiffness_N"));
  }
}

}  // namespace tendril::config
