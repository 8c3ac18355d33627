// The daemon file, key by key: the single definition of its keys, accepted ranges, rules between them, and
// meanings. Used with Reader to parse, with Writer to write back, and with Lister for the reference.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "describe_optional.h"
#include "reader.h"
#include "tendril/core/daemon.h"
#include "tendril/core/limits.h"
#include "text_rules.h"

namespace tendril::config {

inline constexpr double kMostSmoothing_s = 10;  // seconds of cycles are kept in memory

template <class Io>
void Describe(Io& io, TrajectoryParameters& p) {
  io.Number("default_speed_radps", p.default_speed_radps, {1e-4, 100},
            "Bending speed of a move whose command names none; at most max_rate_radps.");
  io.Number("max_rate_radps", p.max_rate_radps, {1e-3, 100}, "Largest bending rate of a section.");
  io.Number("max_acceleration_radps2", p.max_acceleration_radps2, {1e-2, 1e5},
            "Largest bending acceleration; max_rate_radps is reached and left within 10 s.");
  io.Number("max_jerk_radps3", p.max_jerk_radps3, {0.1, 1e8},
            "Largest bending jerk; max_acceleration_radps2 is reached and left within 10 s.");
  OptionalSwitch(
      io, "look_ahead", p.look_ahead, true,
      "Moving targets are extrapolated over the delay of smoothing and drives; off: the sender sends ahead.");
  // The smoothing's windows are in memory and delay all motion by half their length.
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
  io.Number(
      "pull_N", p.pull_N, {1e-3, 1000},
      "Largest pull of one motor by its torque, losses left aside; at most limits.max_tension_motor_N.");
  io.Number("max_speed_mps", p.max_speed_mps, {1e-5, 1}, "Tendon speed at which the torque has faded out.");
  io.Number("max_travel_m", p.max_travel_m, {1e-4, 1},
            "Travel of a tendon, either way, beyond which it counts as broken or loose.");
  io.Number("timeout_s", p.timeout_s, {0.1, 3600}, "Longest duration of homing.");
}

template <class Io>
void Describe(Io& io, GuardParameters& p) {
  io.Integer("max_missing_cycles", p.max_missing_cycles, {1, 1000},
             "Cycles in a row without a drive's feedback; one more is a fault.");
  io.Number("slack_tension_N", p.slack_tension_N, {0, 100},
            "A measured tension below it counts as slack; below limits.min_tension_N.");
  io.Number("max_slack_s", p.max_slack_s, {0, 60}, "A tendon that is slack for longer is a fault.");
  io.Number(
      "tension_margin", p.tension_margin, {0, 1},
      "Share above limits.max_tension_motor_N or max_tension_base_N at which a measured tension is a fault; "
      "inferred from torque, where there is no load cell, for confirm_cycles.");
  io.Integer("confirm_cycles", p.confirm_cycles, {1, 1000},
             "Cycles in a row that a guard with confirmation must be broken.");
  io.Number("tension_disagreement_N", p.tension_disagreement_N, {1e-3, 1000},
            "Largest difference between a load cell and what the motor's torque allows.");
  io.Number("stuck_torque_change_N", p.stuck_torque_change_N, {1e-3, 1000},
            "Change of tension by torque during which a load cell may not keep one value.");
  io.Number("max_displacement_jump_m", p.max_displacement_jump_m, {1e-6, 1},
            "Largest displacement of a tendon in one cycle.");
  io.Number("max_displacement_rate_mps", p.max_displacement_rate_mps, {1e-4, 100},
            "Largest speed of a tendon at its spool.");
  io.Number("max_following_error_m", p.max_following_error_m, {1e-6, 1},
            "Largest difference between a tendon's displacement and its reference.");
  io.Number("max_bending_excess_rad", p.max_bending_excess_rad, {0, 10},
            "Bending angle of the estimate beyond limits.max_bending_rad.");
  io.Number("max_estimator_residual_m", p.max_estimator_residual_m, {1e-6, 1},
            "Largest displacement of a tendon that no shape of the robot explains.");
  NumberOrNominal(io, "max_torque_error_N", p.max_torque_error_N, GuardParameters{}.max_torque_error_N,
                  {1e-3, 1000}, "Largest difference between commanded and reported torque, as tension.");
  io.Integer("max_late_cycles", p.max_late_cycles, {1, 100000},
             "Cycles skipped at once, or within about a second.");
  io.Number("max_stream_silence_s", p.max_stream_silence_s, {0, 3600},
            "Silence after a moving target expired; then the robot holds until it is armed again.");
}

template <class Io>
void Describe(Io& io, ControllerParameters& p) {
  io.Choice("law", p.law,
            Choices<ControlLaw>{{"paper", ControlLaw::kPaper}, {"equilibrium", ControlLaw::kEquilibrium}},
            "Inverse dynamics of constant-curvature arcs, or the equilibrium of every unit with the motors' "
            "own dynamics.");
  OptionalSwitch(io, "tension_feedback", p.tension_feedback, false,
                 "Load cells correct the torques; needs law: equilibrium.");
  io.Check(
      !p.tension_feedback || p.law == ControlLaw::kEquilibrium, "tension_feedback",
      "on without what it corrects; accepted: off, or law: equilibrium beside it; change one of the two");
  OptionalSwitch(io, "shape_feedback", p.shape_feedback, false,
                 "The tendons' displacement corrects the bend slowly; needs tension_feedback: on.");
  io.Check(
      !p.shape_feedback || p.tension_feedback, "shape_feedback",
      "on without the damping that it needs; accepted: off, or tension_feedback: on beside it; change one of "
      "the two");
  OptionalSwitch(
      io, "tip_feedback", p.tip_feedback, false,
      "A tracker corrects the tip slowly; needs tension_feedback: on and a tracker in the robot file.");
  io.Check(
      !p.tip_feedback || p.tension_feedback, "tip_feedback",
      "on without the damping that it needs; accepted: off, or tension_feedback: on beside it; change one of "
      "the two");
  io.Flag("capstan_compensation", p.capstan_compensation,
          "Friction of the pulleys is compensated; false takes them as free of friction.");
  io.Number("pretension_ramp_Nps", p.pretension_ramp_Nps, {1e-3, 1000},
            "Rate at which tensions rise on arm and fall on disarm; takes max_tension_base_N down in 30 s at "
            "most.");
  io.Number("pretension_settle_s", p.pretension_settle_s, {0, 60},
            "Rest after the ramp, before displacement is set to zero.");
  io.Block("trajectory", p.trajectory, "Limits of the reference, per section.");
  io.Block("guards", p.guards, "Thresholds of the guards.");
  if constexpr (Io::kReading) {
    p.take_up = {};
    if (!io.Has("take_up")) return io.Allow("take_up");
  }
  if constexpr (Io::kListing) io.BlockMayBeLeftOut();
  io.Block("take_up", p.take_up,
           "Handling of tendons of which nothing is known yet: commissioning and homing.");
}

template <class Io>
void Describe(Io& io, IdentityParameters& p) {
  io.Identifier("vendor_id", p.vendor_id, "Object 0x1018:01 of every EPOS4.");
  io.Identifiers("product_codes", p.product_codes, {1, 32}, "Accepted values of object 0x1018:02.");
  io.Identifier("min_revision", p.min_revision, "Lowest accepted value of object 0x1018:03.");
  io.Identifier("max_revision", p.max_revision, "Highest accepted value of object 0x1018:03.");
  io.Check(p.min_revision <= p.max_revision, "max_revision",
           fmt::format("0x{:08X} lies below min_revision; accepted: 0x{:08X} or more; swap the two",
                       p.max_revision, p.min_revision));
}

/// Keys of a drive that its maker's EDS file describes; an EPOS4 has none of them.
template <class Io>
void DescribeGenericDrive(Io& io, NodeParameters& p) {
  const bool generic = p.profile == DriveKind::kCia402;
  if (GivenOrOther(io, "eds", p.eds_file, std::string(), "none"))
    io.Text("eds", p.eds_file, kEdsRule, "EDS file of the drive's maker; needed with profile: cia402.");
  io.Check(
      generic || p.eds_file.empty(), "eds",
      "given for an EPOS4, whose objects are known; accepted: profile: cia402 beside it; change one of the "
      "two");
  io.Check(!generic || !p.eds_file.empty(), "profile",
           "cia402 without the drive's objects; accepted: eds: FILE beside it, the EDS file of the drive's "
           "maker; add it");
  if (GivenOrOther(io, "analog_input", p.analog_input, std::string(), "none"))
    io.Text("analog_input", p.analog_input, kObjectRule,
            "Object of the load cell's analog input, for profile: cia402; an EPOS4's is 0x3160:01.");
  io.Check(generic || p.analog_input.empty(), "analog_input",
           "given for an EPOS4, whose load cell is at 0x3160:01; accepted: profile: cia402 beside it; remove "
           "one of the two");
  OptionalNumber(io, "analog_mV_per_count", p.analog_mV_per_count, 1, {1e-6, 1e3, true},
                 "Millivolts per count of analog_input.");
  io.Check(!p.analog_input.empty() || p.analog_mV_per_count == 1, "analog_mV_per_count",
           "given without an input; accepted: analog_input beside it; add it, or remove this");
}

template <class Io>
void Describe(Io& io, NodeParameters& p) {
  io.Integer("node_id", p.node_id, {1, 126},
             "CANopen node of the drive; 127 is the daemon's own.");  // 127 is the master's heartbeat
  io.Integer("tendon", p.tendon, {1, kMaxTendons}, "The tendon that it pulls, counted over all sections.");
  Direction(io, "motor", p.motor_reversed, "reversed: negative torque pulls the tendon.");
  Direction(io, "encoder", p.encoder_reversed, "reversed: counts fall while the motor pulls.");
  if (GivenOrOther(io, "profile", p.profile, DriveKind::kEpos4, "epos4"))
    io.Choice("profile", p.profile, kDriveKinds,
              "epos4: maxon EPOS4; cia402: a drive of any maker with cyclic synchronous torque, by its EDS "
              "file.");
  DescribeGenericDrive(io, p);
}

template <class Io>
void Describe(Io& io, BusParameters& p) {
  io.Text("interface", p.interface, kInterfaceRule, "CAN interface of the drives.");
  constexpr int kBitRates[] = {125000, 250000, 500000, 800000, 1000000};
  io.Integer("bitrate_bps", p.bitrate_bps, {125000, 1000000},
             "Bit rate: 125000, 250000, 500000, 800000 or 1000000.");
  if constexpr (Io::kListing) io.Only(kBitRates);
  io.Integer("cycle_ns", p.cycle_ns, {500000, 100000000}, "Period of the control cycle and of SYNC.");
  io.Integer("feedback_deadline_ns", p.feedback_deadline_ns, {50000, 100000000},
             "Time after SYNC by which feedback must be in; shorter than cycle_ns.");
  io.Integer("heartbeat_ms", p.heartbeat_ms, {5, 10000}, "Period of the heartbeats of daemon and drives.");
  io.Integer("heartbeat_timeout_ms", p.heartbeat_timeout_ms, {10, 32767},
             "Silence after which a drive, or the daemon, counts as lost; at least twice heartbeat_ms.");
  io.Integer("sdo_timeout_ms", p.sdo_timeout_ms, {5, 10000},
             "Longest wait for one SDO answer; shorter than boot_timeout_ms.");
  io.Integer("boot_timeout_ms", p.boot_timeout_ms, {100, 120000},
             "Longest start of one drive, from NMT reset to configured.");
  io.Integer("abort_connection_option", p.abort_connection_option, {2, 3},
             "Object 0x6007, what a drive does that hears no daemon: 2 disables voltage, 3 brakes first.");
  io.Number("max_load", p.max_load, {0.05, 0.8},
            "Largest share of the bit rate in the worst case; above it the daemon does not start.");
  const auto identity = [&] {
    io.Block("identity", p.identity,
             "What object 0x1018 of every EPOS4 must report; of another drive its EDS file says it.");
  };
  if constexpr (Io::kListing) io.MayBeLeftOut("none, where no drive is an EPOS4");
  if (Io::kListing || (!Io::kReading && !p.identity.product_codes.empty())) identity();
  io.List("nodes", p.nodes, {1, kMaxTendons},
          "Which drive pulls which tendon; every tendon of the robot once.");
  if constexpr (Io::kReading) {
    p.identity = {};
    const bool needed = std::any_of(p.nodes.begin(), p.nodes.end(),
                                    [](const NodeParameters& n) { return n.profile == DriveKind::kEpos4; });
    needed || io.Has("identity") ? identity() : io.Allow("identity");
  }

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
  io.Integer("priority", p.priority, {0, 99},
             "Priority of the control loop under SCHED_FIFO; 0: ordinary scheduling.");
  io.Integer("cpu", p.cpu, {-1, 1023}, "CPU of the control loop; -1: any.");
  io.Flag("lock_memory", p.lock_memory, "Locks the memory, so that the loop has no page faults.");
  io.Flag("required", p.required, "true: the daemon does not start without these rights; false: it warns.");
}

template <class Io>
void Describe(Io& io, LcmParameters& p) {
  io.Text("url", p.url, kUrlRule, "LCM address.");
  io.Text("channel_prefix", p.channel_prefix, kPrefixRule,
          "First part of every channel's name, as in PREFIX_STATE.");
  io.Integer("state_every_cycles", p.state_every_cycles, {1, 100000}, "Publishes every n-th state.");
  io.Integer("cycle_every_cycles", p.cycle_every_cycles, {0, 100000},
             "Publishes every n-th cycle record, 0 none; logs for the gap diagnosis need 1.");
  if (GivenOrOther(io, "key_file", p.key_file, std::string(), "none"))
    io.Text("key_file", p.key_file, kKeyRule,
            "File with a key: commands are accepted only if signed with it (HMAC-SHA-256), and once.");
}

template <class Io>
void Describe(Io& io, BlackBoxParameters& p) {
  io.Number("seconds", p.seconds, {1, 120}, "Cycles kept in memory, at least.");
  io.Text("folder", p.folder, kFolderRule, "Folder that gets one log for each fault; the newest 20 stay.");
}

template <class Io>
void Describe(Io& io, DaemonParameters& p) {
  io.Text("robot", p.robot_file, kPathRule, "Path of the robot file.");
  OptionalChoice(io, "commissioning", p.commissioning_required, true,
                 {{"required", true}, {"not_required", false}},
                 "required: arms only a robot whose commissioning record fits its files.");
  OptionalChoice(io, "exchanged_drives", p.exchanged_drives_refused, true,
                 {{"refuse", true}, {"warn", false}},
                 "refuse: a drive with another serial number than recorded arms nothing; warn: it warns.");
  io.Block("controller", p.controller, "Control law, reference limits and guards.");
  io.Block("bus", p.bus, "CAN bus and drives.");
  io.Block("realtime", p.realtime, "Scheduling of the control loop.");
  io.Block("lcm", p.lcm, "Messages.");
  io.OptionalBlock("black_box", p.black_box, "The cycles before a fault, written out at every fault.");
}

}  // namespace tendril::config
