// The daemon file, key by key: the one place that says which keys there are, their accepted ranges and the
// rules between them. Used with Reader to parse and with Writer to write back.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "reader.h"
#include "tendril/core/daemon.h"
#include "tendril/core/limits.h"
#include "text_rules.h"

namespace tendril::config {

/// `nominal` unless given; always written.
template <class Io>
void OptionalChoice(Io& io, std::string_view key, bool& value, bool nominal, const Choices<bool>& choices) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (!io.Has(key)) return io.Allow(key);
  }
  io.Choice(key, value, choices);
}
template <class Io>
void OptionalSwitch(Io& io, std::string_view key, bool& value, bool nominal) {
  OptionalChoice(io, key, value, nominal, {{"off", false}, {"on", true}});
}

inline constexpr double kMostSmoothing_s = 10;  // seconds of cycles are kept in memory

template <class Io>
void Describe(Io& io, TrajectoryParameters& p) {
  io.Number("default_speed_radps", p.default_speed_radps, {1e-4, 100});
  io.Number("max_rate_radps", p.max_rate_radps, {1e-3, 100});
  io.Number("max_acceleration_radps2", p.max_acceleration_radps2, {1e-2, 1e5});
  io.Number("max_jerk_radps3", p.max_jerk_radps3, {0.1, 1e8});
  OptionalSwitch(io, "look_ahead", p.look_ahead, true);
  // The smoothing's windows are held in memory, and delay all motion by half their length.
  const double gather_s = 2 * p.max_rate_radps / p.max_acceleration_radps2,
               build_up_s = 2 * p.max_acceleration_radps2 / p.max_jerk_radps3;
  io.Check(!(gather_s > kMostSmoothing_s), "max_acceleration_radps2",
           fmt::format("{:g} takes {:g} s to the max_rate_radps of {:g} and back; accepted: {:g} or more, so "
                       "that it is {:g} s at most; raise it, or lower max_rate_radps",
                       p.max_acceleration_radps2, gather_s, p.max_rate_radps,
                       2 * p.max_rate_radps / kMostSmoothing_s, kMostSmoothing_s));
  io.Check(!(build_up_s > kMostSmoothing_s), "max_jerk_radps3",
           fmt::format("{:g} takes {:g} s to the max_acceleration_radps2 of {:g} and back; accepted: {:g} or "
                       "more, so that it is {:g} s at most; raise it, or lower max_acceleration_radps2",
                       p.max_jerk_radps3, build_up_s, p.max_acceleration_radps2,
                       2 * p.max_acceleration_radps2 / kMostSmoothing_s, kMostSmoothing_s));
  io.Check(p.default_speed_radps <= p.max_rate_radps, "default_speed_radps",
           fmt::format("{} is faster than max_rate_radps allows; accepted: up to {} rad/s; lower it",
                       p.default_speed_radps, p.max_rate_radps));
}

template <class Io>
void Describe(Io& io, TakeUpParameters& p) {
  io.Number("pull_N", p.pull_N, {1e-3, 1000});
  io.Number("max_speed_mps", p.max_speed_mps, {1e-5, 1});
  io.Number("max_travel_m", p.max_travel_m, {1e-4, 1});
  io.Number("timeout_s", p.timeout_s, {0.1, 3600});
}

/// `nominal` unless given; always written.
template <class Io>
void NumberOrNominal(Io& io, std::string_view key, double& value, double nominal, Range range) {
  if constexpr (Io::kReading) {
    value = nominal;
    if (!io.Has(key)) return io.Allow(key);
  }
  io.Number(key, value, range);
}

template <class Io>
void Describe(Io& io, GuardParameters& p) {
  io.Integer("max_missing_cycles", p.max_missing_cycles, {1, 1000});
  io.Number("slack_tension_N", p.slack_tension_N, {0, 100});
  io.Number("max_slack_s", p.max_slack_s, {0, 60});
  io.Number("tension_margin", p.tension_margin, {0, 1});
  io.Integer("confirm_cycles", p.confirm_cycles, {1, 1000});
  io.Number("tension_disagreement_N", p.tension_disagreement_N, {1e-3, 1000});
  io.Number("stuck_torque_change_N", p.stuck_torque_change_N, {1e-3, 1000});
  io.Number("max_displacement_jump_m", p.max_displacement_jump_m, {1e-6, 1});
  io.Number("max_displacement_rate_mps", p.max_displacement_rate_mps, {1e-4, 100});
  io.Number("max_following_error_m", p.max_following_error_m, {1e-6, 1});
  io.Number("max_bending_excess_rad", p.max_bending_excess_rad, {0, 10});
  io.Number("max_estimator_residual_m", p.max_estimator_residual_m, {1e-6, 1});
  NumberOrNominal(io, "max_torque_error_N", p.max_torque_error_N, GuardParameters{}.max_torque_error_N,
                  {1e-3, 1000});
  io.Integer("max_late_cycles", p.max_late_cycles, {1, 100000});
  io.Number("max_stream_silence_s", p.max_stream_silence_s, {0, 3600});
}

template <class Io>
void Describe(Io& io, ControllerParameters& p) {
  io.Choice("law", p.law,
            Choices<ControlLaw>{{"paper", ControlLaw::kPaper}, {"equilibrium", ControlLaw::kEquilibrium}});
  OptionalSwitch(io, "tension_feedback", p.tension_feedback, false);
  io.Check(
      !p.tension_feedback || p.law == ControlLaw::kEquilibrium, "tension_feedback",
      "on without what it corrects; accepted: off, or law: equilibrium beside it; change one of the two");
  OptionalSwitch(io, "shape_feedback", p.shape_feedback, false);
  io.Check(
      !p.shape_feedback || p.tension_feedback, "shape_feedback",
      "on without the damping that it needs; accepted: off, or tension_feedback: on beside it; change one of "
      "the two");
  OptionalSwitch(io, "tip_feedback", p.tip_feedback, false);
  io.Check(
      !p.tip_feedback || p.tension_feedback, "tip_feedback",
      "on without the damping that it needs; accepted: off, or tension_feedback: on beside it; change one of "
      "the two");
  io.Flag("capstan_compensation", p.capstan_compensation);
  io.Number("pretension_ramp_Nps", p.pretension_ramp_Nps, {1e-3, 1000});
  io.Number("pretension_settle_s", p.pretension_settle_s, {0, 60});
  io.Block("trajectory", p.trajectory);
  io.Block("guards", p.guards);
  if constexpr (Io::kReading) {
    p.take_up = {};
    if (!io.Has("take_up")) return io.Allow("take_up");
  }
  io.Block("take_up", p.take_up);
}

template <class Io>
void Describe(Io& io, IdentityParameters& p) {
  io.Identifier("vendor_id", p.vendor_id);
  io.Identifiers("product_codes", p.product_codes, {1, 32});
  io.Identifier("min_revision", p.min_revision);
  io.Identifier("max_revision", p.max_revision);
  io.Check(p.min_revision <= p.max_revision, "max_revision",
           fmt::format("0x{:08X} lies below min_revision; accepted: 0x{:08X} or more; swap the two",
                       p.max_revision, p.min_revision));
}

/// As usual unless given, and written only where it is not.
template <class Io>
void Direction(Io& io, std::string_view key, bool& reversed) {
  if constexpr (Io::kReading) {
    reversed = false;
    if (!io.Has(key)) return io.Allow(key);
  } else if (!reversed) {
    return;
  }
  io.Choice(key, reversed, Choices<bool>{{"normal", false}, {"reversed", true}});
}

template <class Io>
void Describe(Io& io, NodeParameters& p) {
  io.Integer("node_id", p.node_id, {1, 126});  // 127 is the master's heartbeat
  io.Integer("tendon", p.tendon, {1, kMaxTendons});
  Direction(io, "motor", p.motor_reversed);
  Direction(io, "encoder", p.encoder_reversed);
}

template <class Io>
void Describe(Io& io, BusParameters& p) {
  io.Text("interface", p.interface, kInterfaceRule);
  io.Integer("bitrate_bps", p.bitrate_bps, {125000, 1000000});
  io.Integer("cycle_ns", p.cycle_ns, {500000, 100000000});
  io.Integer("feedback_deadline_ns", p.feedback_deadline_ns, {50000, 100000000});
  io.Integer("heartbeat_ms", p.heartbeat_ms, {5, 10000});
  io.Integer("heartbeat_timeout_ms", p.heartbeat_timeout_ms, {10, 32767});
  io.Integer("sdo_timeout_ms", p.sdo_timeout_ms, {5, 10000});
  io.Integer("boot_timeout_ms", p.boot_timeout_ms, {100, 120000});
  io.Integer("abort_connection_option", p.abort_connection_option, {2, 3});
  io.Number("max_load", p.max_load, {0.05, 0.8});
  io.Block("identity", p.identity);
  io.List("nodes", p.nodes, {1, kMaxTendons});

  constexpr int kBitRates[] = {125000, 250000, 500000, 800000, 1000000};
  io.Check(std::find(std::begin(kBitRates), std::end(kBitRates), p.bitrate_bps) != std::end(kBitRates),
           "bitrate_bps",
           fmt::format("{} is not a CANopen bit rate; accepted: {} bit/s; choose one", p.bitrate_bps,
                       fmt::join(kBitRates, ", ")));
  io.Check(
      p.feedback_deadline_ns < p.cycle_ns, "feedback_deadline_ns",
      fmt::format(
          "{} is not within the cycle; accepted: below cycle_ns, {} ns, with room for the torque frames; "
          "lower it",
          p.feedback_deadline_ns, p.cycle_ns));
  io.Check(
      p.heartbeat_timeout_ms >= 2 * p.heartbeat_ms, "heartbeat_timeout_ms",
      fmt::format("{} would trip on one late heartbeat; accepted: {} ms (2 x heartbeat_ms) or more; raise it",
                  p.heartbeat_timeout_ms, 2 * p.heartbeat_ms));
  io.Check(p.sdo_timeout_ms < p.boot_timeout_ms, "sdo_timeout_ms",
           fmt::format("{} is not within boot_timeout_ms; accepted: below {} ms; lower it", p.sdo_timeout_ms,
                       p.boot_timeout_ms));
  for (std::size_t i = 0; i < p.nodes.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      io.Check(p.nodes[i].node_id != p.nodes[k].node_id, "nodes",
               fmt::format("node_id {} twice; accepted: 1 .. 126, all different; correct one",
                           p.nodes[i].node_id));
      io.Check(p.nodes[i].tendon != p.nodes[k].tendon, "nodes",
               fmt::format("tendon {} twice; accepted: every tendon once; correct one", p.nodes[i].tendon));
    }
  }
  std::sort(p.nodes.begin(), p.nodes.end(),
            [](const NodeParameters& a, const NodeParameters& b) { return a.tendon < b.tendon; });
}

template <class Io>
void Describe(Io& io, RealtimeParameters& p) {
  io.Integer("priority", p.priority, {0, 99});
  io.Integer("cpu", p.cpu, {-1, 1023});
  io.Flag("lock_memory", p.lock_memory);
  io.Flag("required", p.required);
}

template <class Io>
void Describe(Io& io, LcmParameters& p) {
  io.Text("url", p.url, kUrlRule);
  io.Text("channel_prefix", p.channel_prefix, kPrefixRule);
  io.Integer("state_every_cycles", p.state_every_cycles, {1, 100000});
  io.Integer("cycle_every_cycles", p.cycle_every_cycles, {0, 100000});
}

template <class Io>
void Describe(Io& io, BlackBoxParameters& p) {
  io.Number("seconds", p.seconds, {1, 120});
  io.Text("folder", p.folder, kFolderRule);
}

template <class Io>
void Describe(Io& io, DaemonParameters& p) {
  io.Text("robot", p.robot_file, kPathRule);
  OptionalChoice(io, "commissioning", p.commissioning_required, true,
                 {{"required", true}, {"not_required", false}});
  OptionalChoice(io, "exchanged_drives", p.exchanged_drives_refused, true,
                 {{"refuse", true}, {"warn", false}});
  io.Block("controller", p.controller);
  io.Block("bus", p.bus);
  io.Block("realtime", p.realtime);
  io.Block("lcm", p.lcm);
  io.OptionalBlock("black_box", p.black_box);
}

}  // namespace tendril::config
