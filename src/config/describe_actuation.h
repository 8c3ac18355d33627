// The robot file's block actuation, key by key: the drivetrain of each tendon and the tracker. Used as
// describe_robot.h.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "describe_optional.h"
#include "lister.h"
#include "reader.h"
#include "tendril/core/limits.h"
#include "tendril/core/load_cell_place.h"
#include "tendril/core/robot.h"
#include "text_rules.h"

namespace tendril::config {

template <class Io>
void Describe(Io& io, MotorParameters& p) {
  io.Number("torque_constant_NmpA", p.torque_constant_NmpA, {1e-4, 10}, "Torque constant of the motor.");
  io.Number("nominal_current_A", p.nominal_current_A, {0.01, 100},
            "Nominal current; per mille of torque on the bus refer to it.");
  io.Number("rotor_inertia_kgm2", p.rotor_inertia_kgm2, {1e-10, 1e-2}, "Inertia of the rotor.");
  io.Number("coulomb_friction_Nm", p.coulomb_friction_Nm, {0, 1}, "Coulomb friction at the motor shaft.");
  io.Number("coulomb_angle_rad", p.coulomb_angle_rad, {1e-6, 1},
            "Angle over which Coulomb friction builds up after a reversal (Dahl).");
  io.Number("coulomb_damping_Nms", p.coulomb_damping_Nms, {0, 1e-2},
            "Micro-damping of the Coulomb element while it builds up.");
  io.Number("viscous_friction_Nms", p.viscous_friction_Nms, {0, 1e-2},
            "Viscous friction at the motor shaft.");
  io.Number("torque_lag_s", p.torque_lag_s, {0, 0.1}, "Time constant of the torque loop, first order.");
  NumberOrNominal(io, "torque_scale", p.torque_scale, 1, {0.1, 10},
                  "Real shaft torque over current times torque_constant_NmpA.");
}

template <class Io>
void Describe(Io& io, DriveParameters& p) {
  io.Number("rated_torque_Nm", p.rated_torque_Nm, {1e-6, 1000},
            "Object 0x6076: torque_constant_NmpA times nominal_current_A, within 1 %.");
  io.Number("current_limit_A", p.current_limit_A, {0.01, 100},
            "Output current limit of the drive: object 0x3001:02 of an EPOS4; of others the torque limit "
            "0x6072, per mille of nominal current.");
  io.Integer("encoder_counts_per_turn", p.encoder_counts_per_turn, {1, 1e8},
             "Counts of object 0x6064 for one turn of the motor shaft.");
  io.Number("actual_torque_noise_permille", p.actual_torque_noise_permille, {0, 100},
            "Noise of the reported torque, rms.");
}

template <class Io>
void Describe(Io& io, GearParameters& p) {
  io.Number("ratio", p.ratio, {0.01, 1e5}, "Motor turns for one turn of the spool.");
  io.Number("efficiency", p.efficiency, {0, 1, true},
            "Efficiency while the motor drives; its inverse while the tendon drives the motor.");
  io.Numbers(
      "presliding_yields_rad", p.presliding_yields_rad, {0, 10, true}, {1, 16},
      "Motor angles over which the direction of the gear's losses changes; stop operators in parallel.");
}

template <class Io>
void Describe(Io& io, SpoolParameters& p) {
  io.Number("radius_m", p.radius_m, {1e-4, 1}, "Radius at which the tendon winds.");
}

template <class Io>
void Describe(Io& io, TendonParameters& p) {
  io.Number("stiffness_Npm", p.stiffness_Npm, {100, 1e8},
            "Stiffness of the whole tendon, from spool to end.");
  io.Number("damping_Nspm", p.damping_Nspm, {0, 1e4}, "Damping of the whole tendon.");
  io.Number("free_length_m", p.free_length_m, {0, 10}, "Length from the spool to the robot's base.");
}

template <class Io>
void Describe(Io& io, PulleyParameters& p) {
  io.Choice("law", p.law,
            Choices<CapstanLaw>{{"cumulative", CapstanLaw::kCumulative},
                                {"local", CapstanLaw::kLocal},
                                {"classic", CapstanLaw::kClassic}},
            "Capstan law: power law of cumulative friction (the paper), of its local density, or the classic "
            "exponential.");
  io.Number("wrap_rad", p.wrap_rad, {0, 30}, "Angle over which the tendon lies on the pulley.");
  io.Number("radius_ratio", p.radius_ratio, {0.1, 1e6}, "Pulley radius over tendon radius.");
  io.Number("alpha", p.alpha, {0, 5}, "Friction coefficient of the law, N^(1 - exponent).");
  io.Number("exponent", p.exponent, {0.05, 1}, "Exponent n of the power law; 1 is the classic Capstan law.");
  io.Number("entry_angle_rad", p.entry_angle_rad, {0, 1.5}, "Angle φ₁ at which the tendon enters.");
}

template <class Io>
void Describe(Io& io, TransmissionParameters& p) {
  io.List("pulleys", p.pulleys, {0, 16}, "Guide pulleys and sheath bends from the base towards the motor.");
  io.Number("presliding_m", p.presliding_m, {1e-9, 0.1},
            "Sliding distance over which friction turns round after a reversal.");
  io.Number("low_tension_N", p.low_tension_N, {1e-6, 100},
            "Below it both sides keep their ratio; at most limits.min_tension_N.");
  NumberOrNominal(io, "coulomb_N", p.coulomb_N, 0, {0, 10000},
                  "Friction of the pulleys that does not depend on the tension.");
}

template <class Io>
void Describe(Io& io, LoadCellParameters& p) {
  io.Choice("place", p.place, kLoadCellPlaces,
            "Between spool and pulleys, between pulleys and base, or no load cell.");
  const bool none = !Io::kListing && p.place == LoadCellPlace::kNone;
  const auto number = [&](const char* key, double& value, Range range, std::string_view meaning) {
    if constexpr (Io::kReading) {
      if (none && !io.Has(key)) return io.Allow(key);  // a cell that is not there has no data
    }
    if (none) range.min = 0;
    io.Number(key, value, range, meaning);
  };
  if constexpr (Io::kListing) io.NeedlessWhere("place", "none");
  number("gain_VpN", p.gain_VpN, {1e-6, 1000},
         "Output of the cell; times max_tension_motor_N at most 10 V. Needless without a cell.");
  number("resolution_V", p.resolution_V, {1e-6, 10},
         "Step of the drive's analog input. Needless without a cell.");
  number("noise_N", p.noise_N, {0, 100}, "Noise of the reading, rms. Needless without a cell.");
  if constexpr (Io::kListing) io.NeedlessWhere("", "");
  NumberOrNominal(io, "offset_N", p.offset_N, 0, {-10000, 10000},
                  "Offset of the reading: gain times (tension + offset).");
}

template <class Io>
void Describe(Io& io, TrackerParameters& p) {
  io.Number("rate_Hz", p.rate_Hz, {0.1, 1e4}, "Readings a second.");
  io.Number("position_noise_m", p.position_noise_m, {0, 1}, "Noise of the position on each axis, rms.");
  io.Number("orientation_noise_rad", p.orientation_noise_rad, {0, 3},
            "Noise of the orientation on each axis, rms.");
  io.Number("delay_s", p.delay_s, {0, 10}, "From the measurement to the time stamp of its reading.");
}

/// The blocks of one tendon's drivetrain; its node id is in the list `nodes`.
template <class Io>
void Describe(Io& io, TendonDriveParameters& p) {
  io.Block("motor", p.motor, "Motor of each tendon.");
  io.Block("drive", p.drive, "Drive of each tendon, as it counts and limits.");
  io.Block("gear", p.gear, "Gear between motor and spool.");
  io.Block("spool", p.spool, "Spool that winds the tendon.");
  io.Block("tendon", p.tendon, "The tendon itself, a spring and damper that only pulls.");
  io.Block("transmission", p.transmission, "Pulleys and sheaths between spool and base.");
  io.Block("load_cell", p.load_cell, "Load cell on the drive's analog input.");
}

/// Rules between the blocks of tendon `j` and the robot's limits; errors are reported at the tendon's own key
/// where it has one.
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

template <class Io>
void Describe(Io& io, TendonPair& p) {
  std::vector<long long> tendons{p.first + 1, p.second + 1};
  io.Integers("tendons", tendons, {1, kMaxTendons}, {2, 2},
              "The tendon that a positive motor angle pulls, and the opposite one.");
  io.Number("pretension_N", p.pretension_N, {1e-3, 10000},
            "Tension of both at the spool, on the straight robot while the motor does not pull; above "
            "limits.min_tension_N.");
  p.first = static_cast<int>(tendons[0]) - 1;
  p.second = static_cast<int>(tendons[1]) - 1;
}

template <class Io>
void DescribePairs(Io& io, std::vector<TendonPair>& pairs) {
  io.List("pairs", pairs, {0, kMaxTendons / 2},
          "Opposite tendons on one motor, wound in opposite directions.");
}

template <class Io>
void DescribeNodeIds(Io& io, std::vector<long long>& nodes, int drives) {
  io.Integers("nodes", nodes, {1, 127}, {static_cast<double>(drives), static_cast<double>(drives)},
              "CANopen node of each drive, in tendon order, all different; a pair has one, that of its first "
              "tendon. tendril-plant answers as these.");
}

inline std::string TendonsText(const TendonPair& pair) {
  return fmt::format("tendons {} and {}", pair.first + 1, pair.second + 1);
}

/// Whether two tendons of a section lie opposite each other all along, but for what drilling misses.
inline bool Opposite(const TendonRoute& a, const TendonRoute& b) {
  constexpr double kAngle_rad = 3 * std::numbers::pi / 180, kRadius = 0.02;
  const double off_rad = std::remainder(a.angle_rad + std::numbers::pi - b.angle_rad, 2 * std::numbers::pi);
  const auto alike = [](double x_m, double y_m) { return std::abs(x_m - y_m) <= kRadius * x_m; };
  return std::abs(off_rad) <= kAngle_rad && alike(a.radius_m, b.radius_m) &&
         alike(a.end_radius_m.value_or(a.radius_m), b.end_radius_m.value_or(b.radius_m)) &&
         a.turn_rad_per_m == b.turn_rad_per_m && a.ends_at_disk == b.ends_at_disk;
}

/// Rules of the pairs among the tendons of `body`.
inline void CheckPairs(Reader& io, const std::vector<TendonPair>& pairs, const BodyParameters& body,
                       const LimitParameters& limits) {
  std::vector<std::size_t> section_of;  // by tendon, from 1
  for (std::size_t k = 0; k < body.sections.size(); ++k)
    section_of.insert(section_of.end(), body.sections[k].tendons.size(), k + 1);
  const int tendons = body.tendons();
  std::vector<int> used(section_of.size(), 0);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const TendonPair& pair = pairs[i];
    const auto rule = [&](bool good, std::string_view key, const std::string& wrong_accepted) {
      io.Check(good, fmt::format("pairs[{}].{}", i + 1, key), wrong_accepted + "; correct the pair");
    };
    const bool there = std::max(pair.first, pair.second) < tendons;
    rule(there, "tendons",
         fmt::format("{} are a pair, and the robot has {}; accepted: two of the tendons 1 .. {}",
                     TendonsText(pair), tendons, tendons));
    if (!there) continue;
    const auto a = static_cast<std::size_t>(pair.first), b = static_cast<std::size_t>(pair.second);
    rule(
        ++used[a] == 1 && ++used[b] == 1, "tendons",
        fmt::format("one of {} is named twice; accepted: every tendon once in all pairs", TendonsText(pair)));
    rule(section_of[a] == section_of[b], "tendons",
         fmt::format("{} belong to sections {} and {}; accepted: two tendons of one section",
                     TendonsText(pair), section_of[a], section_of[b]));
    rule(Opposite(body.RouteOf(pair.first), body.RouteOf(pair.second)), "tendons",
         fmt::format("{} do not lie opposite each other, so that one motor would stretch or slacken both; "
                     "accepted: holes 180° apart within 3°, at the same radius within 2 %, to the same disk",
                     TendonsText(pair)));
    const double most_N = std::min(limits.max_tension_base_N, limits.max_tension_motor_N);
    rule(pair.pretension_N > limits.min_tension_N && pair.pretension_N < most_N, "pretension_N",
         fmt::format("{}; accepted: above limits.min_tension_N, {} N, and below max_tension_base_N and "
                     "max_tension_motor_N, {} N",
                     pair.pretension_N, limits.min_tension_N, most_N));
  }
}

template <class Io>
void DescribeTracker(Io& io, std::optional<TrackerParameters>& tracker) {
  io.OptionalBlock("tracker", tracker, "An outside measurement of the tip's pose.");
}

/// The keys of the block `actuation`: those of a tendon, and those common to all.
inline void DescribeActuation(Lister& io, ActuationParameters& p) {
  std::vector<long long> nodes;
  io.MayBeLeftOut("1, 2, ... in tendon order");
  DescribeNodeIds(io, nodes, kMaxTendons);
  io.MayBeLeftOut("a motor for every tendon");
  DescribePairs(io, p.pairs);
  TendonDriveParameters drive;
  Describe(io, drive);
  io.MayBeLeftOut("all tendons alike");
  io.Mapping("per_tendon",
             "a tendon's number, and below it the blocks of actuation with the keys that differ",
             "Tendons that differ from the common blocks.");
  DescribeTracker(io, p.tracker);
}

/// What the second tendon of a pair has from the first's drive; `own` are the second's keys in per_tendon.
inline void ShareDrive(Reader& io, const TendonPair& pair, const Layer& own,
                       std::vector<TendonDriveParameters>& tendons) {
  const TendonDriveParameters& first = tendons[static_cast<std::size_t>(pair.first)];
  TendonDriveParameters& second = tendons[static_cast<std::size_t>(pair.second)];
  io.Check(first.load_cell.place == LoadCellPlace::kNone && second.load_cell.place == LoadCellPlace::kNone,
           "pairs",
           fmt::format("{} have a load cell, and a drive has one analog input for the two; accepted: "
                       "load_cell.place: none; correct it in per_tendon",
                       TendonsText(pair)));
  const auto says = [&own](std::string_view key) {
    return own.line > 0 && std::any_of(own.map.begin(), own.map.end(),
                                       [key](const auto& entry) { return entry.first.Scalar() == key; });
  };
  const bool same =
      (!says("motor") || first.motor == second.motor) && (!says("drive") || first.drive == second.drive) &&
      (!says("gear") || first.gear == second.gear) && (!says("spool") || first.spool == second.spool);
  io.Check(same, "pairs",
           fmt::format("{} have one motor, drive, gear and spool, and per_tendon gives them different ones; "
                       "accepted: those of tendon {}; remove the others",
                       TendonsText(pair), pair.first + 1));
  second.motor = first.motor;
  second.drive = first.drive;
  second.gear = first.gear;
  second.spool = first.spool;
  second.node_id = first.node_id;
}

/// All tendons' drivetrains: the common blocks, overridden per tendon.
inline void ReadActuation(Reader& io, const std::vector<Layer>& layers, const BodyParameters& body,
                          const LimitParameters& limits, ActuationParameters& p) {
  const int tendons = body.tendons();
  const Source& source = io.source();
  const Layer& common = layers.back();

  Reader top(source, {common});
  DescribeTracker(top, p.tracker);
  p.pairs.clear();
  if (top.Has("pairs")) DescribePairs(top, p.pairs);
  CheckPairs(top, p.pairs, body, limits);
  const int drives = tendons - static_cast<int>(p.pairs.size());
  std::vector<long long> nodes;
  if (top.Has("nodes")) {
    DescribeNodeIds(top, nodes, drives);
    for (std::size_t j = 0; j < nodes.size(); ++j) {
      top.Check(
          std::count(nodes.begin(), nodes.end(), nodes[j]) == 1, "nodes",
          fmt::format("node {} twice; accepted: one id 1 .. 127 a drive, all different; correct the list",
                      nodes[j]));
    }
  } else {
    for (int j = 1; j <= drives; ++j) nodes.push_back(j);
  }
  std::vector<Layer> overrides;
  if (top.Has("per_tendon")) overrides = top.Children("per_tendon");

  p.tendons.clear();
  std::size_t drive_at = 0;
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
    for (const char* key : {"tracker", "nodes", "per_tendon", "pairs"}) reader.AllowInCommon(key);
    TendonDriveParameters& drive = p.tendons.emplace_back();
    Describe(reader, drive);
    reader.Finish();
    CheckTendon(reader, j, drive, limits);
    if (p.HasDrive(j - 1)) drive.node_id = static_cast<int>(nodes[drive_at++]);
  }
  for (const TendonPair& pair : p.pairs)
    ShareDrive(top, pair, own[static_cast<std::size_t>(pair.second)], p.tendons);
}

}  // namespace tendril::config
