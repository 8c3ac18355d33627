// The robot file, key by key: the single definition of its keys, accepted ranges, rules between them, and
// meanings. Used with Reader to parse, with Writer to write back, and with Lister for the reference.
#pragma once

#include <fmt/format.h>

#include <string>

#include "describe_actuation.h"
#include "describe_body.h"
#include "describe_optional.h"
#include "lister.h"
#include "reader.h"
#include "tendril/core/limits.h"
#include "tendril/core/robot.h"
#include "text_rules.h"

namespace tendril::config {

template <class Io>
void Describe(Io& io, LimitParameters& p) {
  io.Number("min_tension_N", p.min_tension_N, {1e-3, 1000},
            "Pretension at the base, and the least tension that any tendon is given.");
  io.Number("max_tension_base_N", p.max_tension_base_N, {1e-2, 10000},
            "Largest tension at the robot's base; above min_tension_N.");
  io.Number("max_tension_motor_N", p.max_tension_motor_N, {1e-2, 10000},
            "Largest tension on the motor side of the pulleys; above min_tension_N.");
  io.Number("max_bending_rad", p.max_bending_rad, {0.01, 6.2},
            "Largest bending angle of a section; below the angle at which its disks touch.");
  const std::string rule =
      fmt::format("accepted: above min_tension_N, {} N; raise it, or lower min_tension_N", p.min_tension_N);
  io.Check(p.max_tension_base_N > p.min_tension_N, "max_tension_base_N",
           fmt::format("{} is not above the minimum; {}", p.max_tension_base_N, rule));
  io.Check(p.max_tension_motor_N > p.min_tension_N, "max_tension_motor_N",
           fmt::format("{} is not above the minimum; {}", p.max_tension_motor_N, rule));
}

/// Every key but two is a parameter; the simulator knows the parameters and their bounds.
template <class Io>
void Describe(Io& io, EffectSetting& p) {
  constexpr Range kEffectValues{-1e6, 1e6};
  const auto where = [&] { io.Text("where", p.where, kPlaceRule, "Where the robot has it."); };
  io.Text("effect", p.name, kNameRule, "Name of an effect of the library; tendril gap explain lists them.");
  if constexpr (Io::kReading) {
    p.where = "all";
    p.values.clear();
    if (io.Has("where")) {
      where();
    } else {
      io.Allow("where");
    }
    for (const auto& entry : io.layers().back().map) {
      const std::string key = entry.first.Scalar();
      if (key == "effect" || key == "where") continue;
      io.Number(key, p.values.emplace_back(key, 0).second, kEffectValues, "");
    }
  } else if constexpr (Io::kListing) {
    io.MayBeLeftOut("all");
    where();
    io.Mapping("PARAMETER", "a number; the effects' reference gives names and bounds",
               "The effect's parameters, by name; at least one that is no shape of the law.", kEffectValues);
  } else {
    where();
    for (auto& [key, value] : p.values) io.Number(key, value, {}, "");
  }
}

template <class Io>
void Describe(Io& io, RobotParameters& p) {
  const auto effects = [&] {
    io.List("effects", p.effects, {0, 1000},
            "Effects that this robot has beyond the nominal model, for the simulator; the controller ignores "
            "them.");
  };
  io.Text("name", p.name, kNameRule, "Name of the robot, for messages and records.");
  io.Block("body", p.body, "Geometry, masses and stiffness.");
  io.Block("limits", p.limits, "What the controller may ask of the robot.");
  if constexpr (Io::kReading) {
    p.actuation.reset();
    if (p.body.sections.empty() || !io.Has("limits") || !io.Has("actuation")) {
      io.Allow("actuation");
    } else {
      ReadActuation(io, io.Children("actuation"), p.body, p.limits, p.actuation.emplace());
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
      effects();
    } else {
      io.Allow("effects");
    }
  } else if constexpr (Io::kListing) {
    io.MayBeLeftOut("a body alone, good for tendril model");
    io.Group("actuation",
             "Motors, drives, tendons and sensors: the same for every tendon, but for per_tendon.",
             [&](Lister& inside) { DescribeActuation(inside, p.actuation.emplace()); });
    io.MayBeLeftOut("none");
    effects();
  } else {
    if (p.actuation) WriteActuation(io, *p.actuation);
    if (!p.effects.empty()) effects();
  }
}

}  // namespace tendril::config
