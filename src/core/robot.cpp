#include "tendril/core/robot.h"

#include <algorithm>
#include <numbers>

namespace tendril {

double SectionParameters::UnitStiffness() const {
  const double r2 = core_radius_m * core_radius_m;
  return youngs_modulus_Pa * std::numbers::pi * r2 * r2 / 4 / unit_length_m;
}

int BodyParameters::units() const {
  int n = 0;
  for (const auto& s : sections) n += s.units;
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
    for (const TendonRoute& tendon : section.tendons) radius_m = std::max(radius_m, tendon.radius_m);
  }
  return radius_m;
}

UnitDeviation& BodyParameters::DeviationOf(int unit) {
  const auto at = std::lower_bound(unit_deviations.begin(), unit_deviations.end(), unit,
                                   [](const UnitDeviation& d, int number) { return d.unit < number; });
  if (at != unit_deviations.end() && at->unit == unit) return *at;
  return *unit_deviations.insert(at, {.unit = unit});
}

}  // namespace tendril
