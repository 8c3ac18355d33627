// A section of a hose with four tendons, as hanging robots have: soft, and heavy for it.
#pragma once

#include <numbers>

#include "tendril/core/robot.h"

namespace tendril {

/// `turn_rad`: of its tendons about the axis.
inline SectionParameters HoseSection(int units, double unit_length_m, double turn_rad) {
  SectionParameters section;
  section.units = units;
  section.unit_length_m = unit_length_m;
  section.unit_mass_kg = 0.02;
  section.disk_inertia_xx_kgm2 = section.disk_inertia_zz_kgm2 = 1e-6;
  section.youngs_modulus_Pa = 2e7;
  section.core_radius_m = 0.008;
  section.bending_damping_Nms = 1e-3;
  for (int j = 0; j < 4; ++j)
    section.tendons.push_back({.angle_rad = turn_rad + j * std::numbers::pi / 2, .radius_m = 0.025});
  return section;
}

}  // namespace tendril
