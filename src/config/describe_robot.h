// The robot file, key by key: the one place that says which keys there are, their accepted ranges and the
// rules between them. Used with Reader to parse and with Writer to write back.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "reader.h"
#include "tendril/core/limits.h"
#include "tendril/core/robot.h"
#include "text_rules.h"

namespace tendril::config {

template <class Io>
void Describe(Io& io, TendonRoute& p) {
  io.Number("angle_rad", p.angle_rad, {-6.3, 6.3});
  io.Number("radius_m", p.radius_m, {1e-4, 0.5});
}

template <class Io>
void Describe(Io& io, SectionParameters& p) {
  io.Integer("units", p.units, {1, kMaxUnits});
  io.Number("unit_length_m", p.unit_length_m, {1e-4, 1});
  io.Number("unit_mass_kg", p.unit_mass_kg, {1e-7, 10});
  double disk_diameter_m = 0;
  if constexpr (Io::kReading) {
    // Either both inertias, or the diameter of a uniform thin disk: I_xx = m d^2 / 16, I_zz = m d^2 / 8.
    if (io.Has("disk_diameter_m")) {
      for (const char* other : {"disk_inertia_xx_kgm2", "disk_inertia_zz_kgm2"}) {
        io.Check(
            !io.Has(other), other,
            "given beside disk_diameter_m; accepted: either disk_diameter_m, or disk_inertia_xx_kgm2 and "
            "disk_inertia_zz_kgm2; remove one of the two");
      }
      io.Number("disk_diameter_m", disk_diameter_m, {1e-4, 1});
      p.disk_inertia_xx_kgm2 = p.unit_mass_kg * disk_diameter_m * disk_diameter_m / 16;
      p.disk_inertia_zz_kgm2 = p.unit_mass_kg * disk_diameter_m * disk_diameter_m / 8;
    } else {
      io.Allow("disk_diameter_m");
    }
  }
  if (disk_diameter_m == 0) {
    io.Number("disk_inertia_xx_kgm2", p.disk_inertia_xx_kgm2, {1e-16, 1});
    io.Number("disk_inertia_zz_kgm2", p.disk_inertia_zz_kgm2, {1e-16, 1});
    io.Check(
        p.disk_inertia_zz_kgm2 <= 2 * p.disk_inertia_xx_kgm2 * (1 + 1e-9), "disk_inertia_zz_kgm2",
        fmt::format(
            "{} is more than any body with this disk_inertia_xx_kgm2 can have; accepted: up to {} kg·m²; "
            "correct one of the two",
            p.disk_inertia_zz_kgm2, 2 * p.disk_inertia_xx_kgm2));
  }
  io.Number("youngs_modulus_Pa", p.youngs_modulus_Pa, {1e6, 1e12});
  io.Number("core_radius_m", p.core_radius_m, {1e-5, 0.05});
  io.Number("bending_damping_Nms", p.bending_damping_Nms, {0, 1000});
  io.List("tendons", p.tendons, {1, kMaxTendons});
  if constexpr (Io::kReading) {
    for (std::size_t j = 0; j < p.tendons.size(); ++j) {
      const double hole_m = p.tendons[j].radius_m;
      io.Check(hole_m > p.core_radius_m, "core_radius_m",
               fmt::format(
                   "{} does not leave room for the hole of tendon {} at {} m; accepted: less than {} m; make "
                   "the backbone thinner or move the hole out",
                   p.core_radius_m, j + 1, hole_m, hole_m));
      io.Check(
          disk_diameter_m == 0 || disk_diameter_m > 2 * hole_m, "disk_diameter_m",
          fmt::format(
              "{} is too small for the hole of tendon {} at {} m; accepted: above {} m; correct one of the "
              "two",
              disk_diameter_m, j + 1, hole_m, 2 * hole_m));
    }
  }
}

/// A key that may be left out: read where it is given, written where it is not the nominal value.
template <class Io>
void OptionalNumber(Io& io, std::string_view key, double& value, double nominal, Range range) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (!io.Has(key)) return io.Allow(key);
  } else if (value == nominal) {
    return;
  }
  io.Number(key, value, range);
}

/// A tendon's key that may be left out: always written, for a tendon that spells out nothing has what the
/// common block says.
template <class Io>
void NumberOr(Io& io, std::string_view key, double& value, double nominal, Range range) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (!io.Has(key)) return io.Allow(key);
  }
  io.Number(key, value, range);
}

template <class Io>
void Describe(Io& io, UnitDeviation& p) {
  io.Integer("unit", p.unit, {1, kMaxUnits});
  OptionalNumber(io, "stiffness_scale", p.stiffness_scale, 1, {0.01, 100});
  OptionalNumber(io, "rest_u_rad", p.rest_u_rad, 0, {-3, 3});
  OptionalNumber(io, "rest_v_rad", p.rest_v_rad, 0, {-3, 3});
}

template <class Io>
void DescribeVector(Io& io, std::string_view key, Eigen::Vector3d& value, Range range) {
  std::vector<double> numbers(value.data(), value.data() + 3);
  io.Numbers(key, numbers, range, {3, 3});
  if (numbers.size() == 3) value = {numbers[0], numbers[1], numbers[2]};
}

/// Keys of the body that a robot like its drawing does without.
template <class Io>
void DescribeDeviations(Io& io, BodyParameters& p) {
  OptionalNumber(io, "tip_payload_kg", p.tip_payload_kg, 0, {0, 1000});
  OptionalNumber(io, "twist_rad_per_m", p.twist_rad_per_m, 0, {-1000, 1000});
  if constexpr (Io::kReading) {
    p.tip_force_W_N.setZero();
    p.unit_deviations.clear();
    for (const char* key : {"tip_force_W_N", "unit_deviations"}) io.Allow(key);
    if (io.Has("tip_force_W_N")) DescribeVector(io, "tip_force_W_N", p.tip_force_W_N, {-100000, 100000});
    if (io.Has("unit_deviations")) io.List("unit_deviations", p.unit_deviations, {0, kMaxUnits});
    std::set<int> seen;
    for (const UnitDeviation& d : p.unit_deviations) {
      io.Check(d.unit <= p.units(), "unit_deviations",
               fmt::format("unit {} does not exist; accepted: 1 .. {}; correct it", d.unit, p.units()));
      io.Check(seen.insert(d.unit).second, "unit_deviations",
               fmt::format("unit {} twice; accepted: at most one entry a unit; join the two", d.unit));
    }
    std::sort(p.unit_deviations.begin(), p.unit_deviations.end(),
              [](const UnitDeviation& a, const UnitDeviation& b) { return a.unit < b.unit; });
  } else {
    if (!p.tip_force_W_N.isZero(0)) DescribeVector(io, "tip_force_W_N", p.tip_force_W_N, {-100000, 100000});
    if (!p.unit_deviations.empty()) io.List("unit_deviations", p.unit_deviations, {0, kMaxUnits});
  }
}

template <class Io>
void Describe(Io& io, BodyParameters& p) {
  DescribeVector(io, "gravity_W_mps2", p.gravity_W_mps2, {-100, 100});
  io.List("sections", p.sections, {1, kMaxSections});
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

template <class Io>
void Describe(Io& io, LimitParameters& p) {
  io.Number("min_tension_N", p.min_tension_N, {1e-3, 1000});
  io.Number("max_tension_base_N", p.max_tension_base_N, {1e-2, 10000});
  io.Number("max_tension_motor_N", p.max_tension_motor_N, {1e-2, 10000});
  io.Number("max_bending_rad", p.max_bending_rad, {0.01, 6.2});
  const std::string rule =
      fmt::format("accepted: above min_tension_N, {} N; raise it, or lower min_tension_N", p.min_tension_N);
  io.Check(p.max_tension_base_N > p.min_tension_N, "max_tension_base_N",
           fmt::format("{} is not above the minimum; {}", p.max_tension_base_N, rule));
  io.Check(p.max_tension_motor_N > p.min_tension_N, "max_tension_motor_N",
           fmt::format("{} is not above the minimum; {}", p.max_tension_motor_N, rule));
}

template <class Io>
void Describe(Io& io, MotorParameters& p) {
  io.Number("torque_constant_NmpA", p.torque_constant_NmpA, {1e-4, 10});
  io.Number("nominal_current_A", p.nominal_current_A, {0.01, 100});
  io.Number("rotor_inertia_kgm2", p.rotor_inertia_kgm2, {1e-10, 1e-2});
  io.Number("coulomb_friction_Nm", p.coulomb_friction_Nm, {0, 1});
  io.Number("coulomb_angle_rad", p.coulomb_angle_rad, {1e-6, 1});
  io.Number("coulomb_damping_Nms", p.coulomb_damping_Nms, {0, 1e-2});
  io.Number("viscous_friction_Nms", p.viscous_friction_Nms, {0, 1e-2});
  io.Number("torque_lag_s", p.torque_lag_s, {0, 0.1});
  NumberOr(io, "torque_scale", p.torque_scale, 1, {0.1, 10});
}

template <class Io>
void Describe(Io& io, DriveParameters& p) {
  io.Number("rated_torque_Nm", p.rated_torque_Nm, {1e-6, 1000});
  io.Number("current_limit_A", p.current_limit_A, {0.01, 100});
  io.Integer("encoder_counts_per_turn", p.encoder_counts_per_turn, {1, 1e8});
  io.Number("actual_torque_noise_permille", p.actual_torque_noise_permille, {0, 100});
}

template <class Io>
void Describe(Io& io, GearParameters& p) {
  io.Number("ratio", p.ratio, {0.01, 1e5});
  io.Number("efficiency", p.efficiency, {0, 1, true});
  io.Numbers("presliding_yields_rad", p.presliding_yields_rad, {0, 10, true}, {1, 16});
}

template <class Io>
void Describe(Io& io, SpoolParameters& p) {
  io.Number("radius_m", p.radius_m, {1e-4, 1});
}

template <class Io>
void Describe(Io& io, TendonParameters& p) {
  io.Number("stiffness_Npm", p.stiffness_Npm, {100, 1e8});
  io.Number("damping_Nspm", p.damping_Nspm, {0, 1e4});
  io.Number("free_length_m", p.free_length_m, {0, 10});
}

template <class Io>
void Describe(Io& io, PulleyParameters& p) {
  io.Choice("law", p.law,
            Choices<CapstanLaw>{{"cumulative", CapstanLaw::kCumulative},
                                {"local", CapstanLaw::kLocal},
                                {"classic", CapstanLaw::kClassic}});
  io.Number("wrap_rad", p.wrap_rad, {0, 30});
  io.Number("radius_ratio", p.radius_ratio, {0.1, 1e6});
  io.Number("alpha", p.alpha, {0, 5});
  io.Number("exponent", p.exponent, {0.05, 1});
  io.Number("entry_angle_rad", p.entry_angle_rad, {0, 1.5});
}

template <class Io>
void Describe(Io& io, TransmissionParameters& p) {
  io.List("pulleys", p.pulleys, {0, 16});
  io.Number("presliding_m", p.presliding_m, {1e-9, 0.1});
  io.Number("low_tension_N", p.low_tension_N, {1e-6, 100});
  NumberOr(io, "coulomb_N", p.coulomb_N, 0, {0, 10000});
}

template <class Io>
void Describe(Io& io, LoadCellParameters& p) {
  io.Choice("place", p.place,
            Choices<LoadCellPlace>{{"motor_side", LoadCellPlace::kMotorSide},
                                   {"robot_side", LoadCellPlace::kRobotSide},
                                   {"none", LoadCellPlace::kNone}});
  const bool none = p.place == LoadCellPlace::kNone;
  const auto number = [&](const char* key, double& value, Range range) {
    if constexpr (Io::kReading) {
      if (none && !io.Has(key)) return io.Allow(key);  // a cell that is not there has no data
    }
    if (none) range.min = 0;
    io.Number(key, value, range);
  };
  number("gain_VpN", p.gain_VpN, {1e-6, 1000});
  number("resolution_V", p.resolution_V, {1e-6, 10});
  number("noise_N", p.noise_N, {0, 100});
  NumberOr(io, "offset_N", p.offset_N, 0, {-10000, 10000});
}

template <class Io>
void Describe(Io& io, TrackerParameters& p) {
  io.Number("rate_Hz", p.rate_Hz, {0.1, 1e4});
  io.Number("position_noise_m", p.position_noise_m, {0, 1});
  io.Number("orientation_noise_rad", p.orientation_noise_rad, {0, 3});
  io.Number("delay_s", p.delay_s, {0, 10});
}

/// The blocks of one tendon's drivetrain; its node id is part of the list `nodes`.
template <class Io>
void Describe(Io& io, TendonDriveParameters& p) {
  io.Block("motor", p.motor);
  io.Block("drive", p.drive);
  io.Block("gear", p.gear);
  io.Block("spool", p.spool);
  io.Block("tendon", p.tendon);
  io.Block("transmission", p.transmission);
  io.Block("load_cell", p.load_cell);
}

/// Rules between the blocks of tendon `j` and the robot's limits; refused at the tendon's own key where it
/// has one.
inline void CheckTendon(Reader& io, int j, const TendonDriveParameters& p, const LimitParameters& limits) {
  const double rated_Nm = p.motor.torque_constant_NmpA * p.motor.nominal_current_A;
  const std::string_view rated = "drive.rated_torque_Nm";
  io.Check(
      std::abs(p.drive.rated_torque_Nm - rated_Nm) <= 0.01 * rated_Nm,
      io.FirstOverridden({rated, "motor.torque_constant_NmpA", "motor.nominal_current_A"}),
      fmt::format(
          "tendon {}: rated_torque_Nm {} does not fit torque_constant_NmpA x nominal_current_A = {:.6g}; "
          "accepted: {:.6g} .. {:.6g} N·m (1 %); correct one of the three",
          j, p.drive.rated_torque_Nm, rated_Nm, 0.99 * rated_Nm, 1.01 * rated_Nm));
  io.Check(p.transmission.low_tension_N <= limits.min_tension_N, "transmission.low_tension_N",
           fmt::format("tendon {}: {} lies above limits.min_tension_N; accepted: up to {} N; lower it", j,
                       p.transmission.low_tension_N, limits.min_tension_N));
  const double full_scale_V = p.load_cell.gain_VpN * limits.max_tension_motor_N;
  io.Check(full_scale_V <= 10, "load_cell.gain_VpN",
           fmt::format("tendon {}: {} gives {:.4g} V at limits.max_tension_motor_N, past the analog input; "
                       "accepted: up to "
                       "{:.6g} V/N; lower one of the two",
                       j, p.load_cell.gain_VpN, full_scale_V, 10 / limits.max_tension_motor_N));
}

/// All tendons' drivetrains: the common blocks, overridden per tendon.
inline void ReadActuation(Reader& io, const std::vector<Layer>& layers, int tendons,
                          const LimitParameters& limits, ActuationParameters& p) {
  const Source& source = io.source();
  const Layer& common = layers.back();

  Reader top(source, {common});
  top.OptionalBlock("tracker", p.tracker);
  std::vector<long long> nodes;
  if (top.Has("nodes")) {
    top.Integers("nodes", nodes, {1, 127}, {static_cast<double>(tendons), static_cast<double>(tendons)});
    for (std::size_t j = 0; j < nodes.size(); ++j) {
      top.Check(
          std::count(nodes.begin(), nodes.end(), nodes[j]) == 1, "nodes",
          fmt::format("node {} twice; accepted: one id 1 .. 127 a tendon, all different; correct the list",
                      nodes[j]));
    }
  } else {
    for (int j = 1; j <= tendons; ++j) nodes.push_back(j);
  }
  std::vector<Layer> overrides;
  if (top.Has("per_tendon")) overrides = top.Children("per_tendon");

  p.tendons.clear();
  std::vector<Layer> own(static_cast<std::size_t>(tendons));
  for (const Layer& map : overrides) {
    const Reader keys_once(source, {map});
    for (const auto& entry : map.map) {
      const std::string& key = entry.first.Scalar();
      int tendon = 0;
      for (int j = 1; j <= tendons; ++j) tendon = key == std::to_string(j) ? j : tendon;
      if (tendon == 0 || !entry.second.IsMap()) {
        keys_once.Refuse(
            key, fmt::format("{}; accepted: a tendon's number 1 .. {} and below it the keys that differ; "
                             "correct it",
                             tendon == 0 ? "is not a tendon" : "is not a mapping", tendons));
      }
      own[static_cast<std::size_t>(tendon - 1)] = {entry.second, map.path + "." + key, LineOf(entry.first)};
    }
  }
  for (int j = 1; j <= tendons; ++j) {
    std::vector<Layer> both;
    Layer& mine = own[static_cast<std::size_t>(j - 1)];
    if (mine.line > 0) both.push_back(mine);
    both.push_back(common);
    Reader reader(source, std::move(both));
    for (const char* key : {"tracker", "nodes", "per_tendon"}) reader.AllowInCommon(key);
    TendonDriveParameters& drive = p.tendons.emplace_back();
    Describe(reader, drive);
    reader.Finish();
    CheckTendon(reader, j, drive, limits);
    drive.node_id = static_cast<int>(nodes[static_cast<std::size_t>(j - 1)]);
  }
}

/// Every key but two is a parameter; which there are, and their bounds, the simulator knows.
template <class Io>
void Describe(Io& io, EffectSetting& p) {
  io.Text("effect", p.name, kNameRule);
  if constexpr (Io::kReading) {
    p.where = "all";
    p.values.clear();
    if (io.Has("where")) {
      io.Text("where", p.where, kPlaceRule);
    } else {
      io.Allow("where");
    }
    for (const auto& entry : io.layers().back().map) {
      const std::string key = entry.first.Scalar();
      if (key == "effect" || key == "where") continue;
      io.Number(key, p.values.emplace_back(key, 0).second, {-1e6, 1e6});
    }
  } else {
    io.Text("where", p.where, kPlaceRule);
    for (auto& [key, value] : p.values) io.Number(key, value, {});
  }
}

template <class Io>
void Describe(Io& io, RobotParameters& p) {
  io.Text("name", p.name, kNameRule);
  io.Block("body", p.body);
  io.Block("limits", p.limits);
  if constexpr (Io::kReading) {
    p.actuation.reset();
    if (p.body.sections.empty() || !io.Has("limits") || !io.Has("actuation")) {
      io.Allow("actuation");
    } else {
      ReadActuation(io, io.Children("actuation"), p.body.tendons(), p.limits, p.actuation.emplace());
    }
    for (std::size_t k = 0; k < p.body.sections.size(); ++k) {
      const SectionParameters& section = p.body.sections[k];
      for (const TendonRoute& t : section.tendons) {
        const double reach_rad = section.units * section.unit_length_m / t.radius_m;
        io.Check(
            p.limits.max_bending_rad < reach_rad, "limits.max_bending_rad",
            fmt::format(
                "at {} the disks of section {} touch at the hole radius {} m; accepted: below {:.6g} rad; "
                "lower it",
                p.limits.max_bending_rad, k + 1, t.radius_m, reach_rad));
      }
    }
    p.effects.clear();
    if (io.Has("effects")) {
      io.List("effects", p.effects, {0, 1000});
    } else {
      io.Allow("effects");
    }
  } else {
    if (p.actuation) WriteActuation(io, *p.actuation);
    if (!p.effects.empty()) io.List("effects", p.effects, {});
  }
}

}  // namespace tendril::config
