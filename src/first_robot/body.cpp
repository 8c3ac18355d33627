// Sections from lengths, diameters and masses as a person measures them.
#include "tendril/model/body.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>
#include <string>

#include "parts.h"
#include "tendril/core/limits.h"
#include "tendril/model/statics.h"

namespace tendril::first_robot {
namespace {

using config::Range;
using std::numbers::pi;

/// In words and numbers for whoever has no data sheet at hand; nitinol as in the paper.
const std::map<std::string, std::string> kMaterials = {{"nitinol", "2.3e10"},   {"steel", "2e11"},
                                                       {"glass_fibre", "4e10"}, {"carbon_fibre", "1.2e11"},
                                                       {"peek", "3.6e9"},       {"nylon", "2.7e9"}};

/// Damping ratio of the first vibration, about that of the shipped rig: nobody knows it before measuring.
constexpr double kDampingRatio = 0.08;
/// A unit's disks touch at a bend of its length over the hole radius: limits.max_bending_rad, at least 0.01,
/// stays below that of the section.
constexpr double kLeastBend_rad = 0.0105;
constexpr double kLeastHole_m = 3e-4;  // neighbouring holes are apart
constexpr double kMostHole_m = 0.49;   // the disk's diameter is within its range

/// The number before a unit ("1100 kg/m3"); no value without that unit.
std::optional<double> InUnit(const std::string& text, std::string_view unit) {
  const std::size_t first = text.find_first_not_of(' ');
  double value = 0;
  if (first == text.npos) return std::nullopt;
  const auto [end, error] = std::from_chars(text.data() + first, text.data() + text.size(), value);
  std::string_view rest(end, static_cast<std::size_t>(text.data() + text.size() - end));
  while (rest.starts_with(' ')) rest.remove_prefix(1);
  while (rest.ends_with(' ')) rest.remove_suffix(1);
  if (error != std::errc() || rest != unit) return std::nullopt;
  return value;
}

double SecondMoment(const SectionParameters& s) { return pi * std::pow(s.core_radius_m, 4) / 4; }

/// One value a section, of functions of the section.
template <class F>
auto ForEach(const std::vector<SectionParameters>& sections, const F& value) {
  std::vector<decltype(value(sections.front()))> values;
  for (const SectionParameters& s : sections) values.push_back(value(s));
  return values;
}

void AskMount(Asker& ask, BodyParameters& body) {
  const double g_mps2 = body.gravity_W_mps2.norm();
  const std::string mount = ask.Choice("mount", {"standing", "hanging", "level"}, "standing");
  body.gravity_W_mps2 = mount == "standing"  ? Eigen::Vector3d(0, 0, -g_mps2)
                        : mount == "hanging" ? Eigen::Vector3d(0, 0, g_mps2)
                                             : Eigen::Vector3d(-g_mps2, 0, 0);
}

void AskLengths(Asker& ask, std::vector<SectionParameters>& sections) {
  const std::size_t count = sections.size();
  const std::vector<double> lengths_m =
      ask.Each("length_m", std::vector<double>(count, 0.06),
               std::vector<Range>(count, ask.RangeOf("body.sections[].unit_length_m")));
  const Range unit_m = ask.RangeOf("body.sections[].unit_length_m");
  std::vector<Range> disks;
  for (const double length_m : lengths_m) {
    const double most = std::min(std::floor(length_m / unit_m.min), std::floor(1. * kMaxUnits / count));
    disks.push_back({1, std::max(1., most)});
  }
  const std::vector<double> units = ask.Each("disks", std::vector<double>(count, 4), disks);
  for (std::size_t k = 0; k < count; ++k) {
    sections[k].units = static_cast<int>(units[k]);
    sections[k].unit_length_m = lengths_m[k] / units[k];
  }
}

/// Evenly around, each section's turned against those before it, no two in one place.
void PlaceTendons(std::vector<SectionParameters>& sections, const std::vector<double>& counts,
                  const std::vector<double>& radii_m) {
  std::vector<double> taken_rad;
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const double apart_rad = 2 * pi / counts[k];
    double first_rad = apart_rad * static_cast<double>(k) / static_cast<double>(sections.size());
    const auto meets = [&] {
      return std::any_of(taken_rad.begin(), taken_rad.end(), [&](double angle_rad) {
        return std::abs(std::remainder(angle_rad - first_rad, apart_rad)) < 0.05;
      });
    };
    while (meets()) first_rad += 0.1;
    sections[k].tendons.clear();
    for (int i = 0; i < counts[k]; ++i) {
      sections[k].tendons.push_back({std::remainder(first_rad + i * apart_rad, 2 * pi), radii_m[k]});
      taken_rad.push_back(sections[k].tendons.back().angle_rad);
    }
    for (TendonRoute& t : sections[k].tendons) t.angle_rad += t.angle_rad < -1e-9 ? 2 * pi : 0;
  }
}

void AskHolesAndDisks(Asker& ask, NewRobot& made, const std::vector<double>& tendons) {
  std::vector<SectionParameters>& sections = made.robot.body.sections;
  const Range hole_m = ask.RangeOf("body.sections[].tendons[].radius_m");
  const std::vector<double> radii_m = ask.Each(
      "hole_radius_m", ForEach(sections, [](const auto& s) { return s.units * s.unit_length_m / 15; }),
      ForEach(sections, [&](const auto& s) {
        return Within(hole_m,
                      {kLeastHole_m, std::min(kMostHole_m, s.units * s.unit_length_m / kLeastBend_rad)});
      }));
  PlaceTendons(sections, tendons, radii_m);
  const Range diameter_m = ask.RangeOf("body.sections[].disk_diameter_m");
  made.disk_diameter_m = ask.Each(
      "disk_diameter_m", ForEach(sections, [](const auto& s) { return 2.5 * s.tendons[0].radius_m; }),
      ForEach(sections, [&](const auto& s) {
        return Within(diameter_m, {2.01 * s.tendons[0].radius_m, 1});
      }));
}

void AskMasses(Asker& ask, NewRobot& made) {
  constexpr double kDensity_kgpm3 = 2100;  // of the shipped rig
  std::vector<SectionParameters>& sections = made.robot.body.sections;
  const Range unit_kg = ask.RangeOf("body.sections[].unit_mass_kg");
  const auto volume_m3 = [&](std::size_t k) {
    return sections[k].units * sections[k].unit_length_m * pi * std::pow(made.disk_diameter_m[k], 2) / 4;
  };
  std::vector<double> usual_kg;
  for (std::size_t k = 0; k < sections.size(); ++k) usual_kg.push_back(kDensity_kgpm3 * volume_m3(k));
  const std::vector<double> masses_kg =
      ask.Each("mass_kg", usual_kg,
               ForEach(sections,
                       [&](const auto& s) {
                         return Range{s.units * unit_kg.min, s.units * unit_kg.max};
                       }),
               [&](std::size_t k, const std::string& text) {
                 const auto density_kgpm3 = InUnit(text, "kg/m3");
                 return density_kgpm3 ? fmt::format("{:.6g}", *density_kgpm3 * volume_m3(k)) : text;
               });
  for (std::size_t k = 0; k < sections.size(); ++k) {
    SectionParameters& s = sections[k];
    s.unit_mass_kg = std::clamp(masses_kg[k] / s.units, unit_kg.min, unit_kg.max);
    s.disk_inertia_xx_kgm2 = s.unit_mass_kg * std::pow(made.disk_diameter_m[k], 2) / 16;
    s.disk_inertia_zz_kgm2 = 2 * s.disk_inertia_xx_kgm2;
  }
}

void AskBackbone(Asker& ask, std::vector<SectionParameters>& sections) {
  const Range radius_m = ask.RangeOf("body.sections[].core_radius_m");
  const Range diameter_m{2 * radius_m.min, 2 * radius_m.max};
  const std::vector<double> diameters_m = ask.Each(
      "backbone_diameter_m", ForEach(sections, [](const auto& s) { return s.tendons[0].radius_m / 4; }),
      ForEach(sections, [&](const auto& s) {
        return Within(diameter_m, {0, 1.99 * s.tendons[0].radius_m});
      }));
  for (std::size_t k = 0; k < sections.size(); ++k) sections[k].core_radius_m = diameters_m[k] / 2;
  const std::vector<double> moduli_Pa = ask.Each(
      "material_Pa", std::vector<double>(sections.size(), 2.3e10),
      std::vector<Range>(sections.size(), ask.RangeOf("body.sections[].youngs_modulus_Pa")),
      [&](std::size_t k, const std::string& text) {
        if (const auto known = kMaterials.find(text); known != kMaterials.end()) return known->second;
        const auto stiffness_Nm2 = InUnit(text, "Nm2");
        return stiffness_Nm2 ? fmt::format("{:.6g}", *stiffness_Nm2 / SecondMoment(sections[k])) : text;
      });
  for (std::size_t k = 0; k < sections.size(); ++k) sections[k].youngs_modulus_Pa = moduli_Pa[k];
}

/// What an answer says of a section's number counts for the keys that follow from it in proportion.
void KeepUncertainties(const Asker& ask, NewRobot& made) {
  for (std::size_t k = 0; k < made.robot.body.sections.size(); ++k) {
    const SectionParameters& s = made.robot.body.sections[k];
    const auto keep = [&](std::string_view name, const std::string& key, double factor) {
      std::optional<Uncertainty> within = ask.WithinOf(name, k);
      if (!within) return;
      if (within->kind == Uncertainty::Kind::kAbsolute) within->deviation *= factor;
      made.robot.uncertain[fmt::format("body.sections[{}].{}", k + 1, key)] = *within;
    };
    keep("length_m", "unit_length_m", 1. / s.units);
    keep("mass_kg", "unit_mass_kg", 1. / s.units);
    keep("disk_diameter_m", "disk_diameter_m", 1);
    keep("backbone_diameter_m", "core_radius_m", 0.5);
    keep("material_Pa", "youngs_modulus_Pa", 1);
    for (std::size_t j = 0; j < s.tendons.size(); ++j)
      keep("hole_radius_m", fmt::format("tendons[{}].radius_m", j + 1), 1);
  }
}

/// From the first natural frequency; of a robot that buckles, from the shipped rig's relation to stiffness.
void SetDamping(BodyParameters& body) {
  const model::Body undamped(body);
  const Eigen::VectorXd no_tension = Eigen::VectorXd::Zero(undamped.tendons());
  const auto rest = model::SolveStatics(undamped, no_tension, Eigen::Vector3d::Zero());
  double time_s = 0.00266;
  if (rest.result == model::StaticsResult::kConverged) {
    const double first_Hz =
        model::NaturalFrequencies(undamped, rest.q, no_tension, Eigen::Vector3d::Zero())[0];
    if (first_Hz > 0) time_s = 2 * kDampingRatio / (2 * pi * first_Hz);
  }
  for (SectionParameters& s : body.sections) {
    s.bending_damping_Nms =
        std::stod(fmt::format("{:.2g}", std::clamp(time_s * s.UnitStiffness(), 0., 1000.)));
  }
}

}  // namespace

void AskBody(Asker& ask, NewRobot& made) {
  BodyParameters& body = made.robot.body;
  AskMount(ask, body);
  const int sections = ask.Integer("sections", 1);
  body.sections.assign(static_cast<std::size_t>(sections), body.sections.front());
  const Range most_tendons{1, std::floor(1. * kMaxTendons / sections)};
  const std::vector<double> tendons = ask.Each("tendons", std::vector<double>(body.sections.size(), 3),
                                               std::vector<Range>(body.sections.size(), most_tendons));
  AskLengths(ask, body.sections);
  AskHolesAndDisks(ask, made, tendons);
  AskMasses(ask, made);
  AskBackbone(ask, body.sections);
  SetDamping(body);
  KeepUncertainties(ask, made);
}

}  // namespace tendril::first_robot
