// tendril status: what a daemon is doing, once or continuously, as a table or JSON.
#include "tendril/core/status.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "commands.h"
#include "lcm_options.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/canopen/emcy.h"
#include "tendril/config/config.h"
#include "tendril/core/clock.h"
#include "tendril/io/client.h"
#include "tendril/io/wire.h"
#include "tendril_lcm/event_t.hpp"
#include "tendril_lcm/run_t.hpp"
#include "tendril_lcm/state_t.hpp"
#include "tendril_lcm/statistics_t.hpp"

namespace tendril::tools {
namespace {

constexpr double kFirstWithin_s = 2;
constexpr TimeNs kRedrawEvery_ns = 200 * kNsPerMs;
constexpr const char* kClearScreen = "\033[H\033[J";

struct StatusOptions {
  LcmOptions lcm;
  bool watch = false, json = false;
};

volatile std::sig_atomic_t interrupted = 0;

/// Who answers: from the run record, which comes once a second.
struct Subject {
  std::string daemon, robot, bus;   // host and process; names
  std::map<int, DriveKind> drives;  // by node id
};

Subject SubjectOf(const tendril_lcm::run_t& message) {
  io::RunInfo run;
  io::FromMessage(message, run);
  Subject subject;
  subject.daemon = run.daemon;
  try {
    subject.robot = config::ParseRobot(run.robot_yaml, "the daemon's robot").name;
    const BusParameters bus = config::ParseDaemon(run.daemon_yaml, "the daemon's file").bus;
    subject.bus = bus.interface;
    for (const NodeParameters& node : bus.nodes) subject.drives[node.node_id] = node.profile;
  } catch (const config::ConfigError&) {
    // Another version's files: the daemon's own line has the names.
  }
  return subject;
}

std::string StateText(int state) {
  constexpr std::array kTexts = {"offline", "booting",     "ready",        "enabled",       "quick stop",
                                 "fault",   "unreachable", "other device", "misconfigured", "id twice"};
  return state >= 0 && state < static_cast<int>(kTexts.size()) ? kTexts[static_cast<std::size_t>(state)]
                                                               : "?";
}

/// With what the code means to its kind of drive, once that is known.
std::string ErrorText(int code, int node_id, const std::optional<Subject>& subject) {
  if (code == 0) return "none";
  std::string text = fmt::format("0x{:04X}", code);
  if (!subject) return text;
  const auto drive = subject->drives.find(node_id);
  if (drive == subject->drives.end()) return text;
  const auto table = canopen::EmcyOf(drive->second);
  return text + " " + canopen::FindEmcy(table, static_cast<std::uint16_t>(code)).text;
}

std::string TimeText(std::int64_t utime) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z", fmt::gmtime(static_cast<std::time_t>(utime / 1'000'000)),
                     utime / 1000 % 1000);
}

nlohmann::json ToJson(const tendril_lcm::state_t& s) {
  return {{"utime", s.utime},
          {"cycle", s.cycle},
          {"mode", s.mode_text},
          {"status", s.status},
          {"status_text", s.status_text},
          {"status_remedy", s.status_remedy},
          {"reported", s.reported},
          {"commands_accepted", s.commands_accepted},
          {"commands_refused", s.commands_refused},
          {"command_sequence", s.command_sequence},
          {"command_status", s.command_status},
          {"command_status_text", s.command_status_text},
          {"target_tip_W_m", s.target_tip_W_m},
          {"target_distance_m", s.target_distance_m},
          {"bending_target_rad", s.bending_target_rad},
          {"bending_desired_rad", s.bending_desired_rad},
          {"bending_rate_desired_radps", s.bending_rate_desired_radps},
          {"bending_estimate_rad", s.bending_estimate_rad},
          {"bending_covariance_rad2", s.bending_covariance_rad2},
          {"tip_desired_W_m", s.tip_desired_W_m},
          {"tip_estimate_W_m", s.tip_estimate_W_m},
          {"orientation_estimate_WT", s.orientation_estimate_WT},
          {"tension_desired_base_N", s.tension_desired_base_N},
          {"tension_desired_motor_N", s.tension_desired_motor_N},
          {"tension_measured_N", s.tension_measured_N},
          {"tension_base_estimate_N", s.tension_base_estimate_N},
          {"displacement_desired_m", s.displacement_desired_m},
          {"displacement_m", s.displacement_m},
          {"torque_desired_Nm", s.torque_desired_Nm},
          {"torque_measured_Nm", s.torque_measured_Nm}};
}

// A value in its column, or a dash where it is not known.
std::string Cell(double value, double scale, int decimals) {
  return std::isnan(value) ? fmt::format("{:>11}", "-") : fmt::format("{:>11.{}f}", scale * value, decimals);
}

std::string Table(const tendril_lcm::state_t& s) {
  std::string t = fmt::format("mode {} (cycle {})\n", s.mode_text, s.cycle);
  if (s.reported.empty()) t += fmt::format("status {} {}\n", s.status, s.status_text);
  for (const std::int16_t number : s.reported) {
    const auto status = static_cast<tendril::Status>(number);
    // The daemon's own words name the drive and the object.
    const bool own_words = number == s.status && !s.status_text.empty();
    t += fmt::format("status {} {}; {}\n", number, own_words ? s.status_text : StatusText(status),
                     StatusRemedy(status));
  }
  t += fmt::format("commands {} accepted, {} refused{}\n\n", s.commands_accepted, s.commands_refused,
                   s.command_status == 0 ? "" : "; last: " + s.command_status_text);
  t += fmt::format("{:<12}{:>11}{:>11}{:>11}\n", "tip [mm]", "x", "y", "z");
  const auto tip = [&](const char* name, const double(&p)[3]) {
    t += fmt::format("{:<12}{}{}{}\n", name, Cell(p[0], 1e3, 2), Cell(p[1], 1e3, 2), Cell(p[2], 1e3, 2));
  };
  tip("  asked for", s.target_tip_W_m);
  if (s.target_distance_m > 0) {
    t.pop_back();
    t += fmt::format("   {:.2f} mm out of reach\n", 1e3 * s.target_distance_m);
  }
  tip("  desired", s.tip_desired_W_m);
  tip("  estimated", s.tip_estimate_W_m);
  t += fmt::format("\n{:<12}{:>11}{:>11}{:>11}{:>11}{:>11}{:>11}\n", "bend [deg]", "u desired", "v",
                   "u estim.", "v", "u +-", "v +-");
  constexpr double kDegrees = 180 / 3.14159265358979323846;
  for (std::size_t k = 0; k + 1 < s.bending_desired_rad.size(); k += 2) {
    const auto deviation = [&](std::size_t i) {
      const std::size_t at = i * s.bending_desired_rad.size() + i;
      return at < s.bending_covariance_rad2.size() ? std::sqrt(s.bending_covariance_rad2[at]) : std::nan("");
    };
    t += fmt::format("  section {:<2}{}{}{}{}{}{}\n", k / 2 + 1, Cell(s.bending_desired_rad[k], kDegrees, 2),
                     Cell(s.bending_desired_rad[k + 1], kDegrees, 2),
                     Cell(s.bending_estimate_rad[k], kDegrees, 2),
                     Cell(s.bending_estimate_rad[k + 1], kDegrees, 2), Cell(deviation(k), kDegrees, 3),
                     Cell(deviation(k + 1), kDegrees, 3));
  }
  t += fmt::format("\n{:<12}{:>11}{:>11}{:>11}{:>11}{:>11}{:>11}\n", "tendon", "base [N]", "motor [N]",
                   "meas. [N]", "pull [mm]", "meas. [mm]", "torq [mNm]");
  for (std::size_t j = 0; j < s.tension_desired_base_N.size(); ++j) {
    t += fmt::format("  {:<10}{}{}{}{}{}{}\n", j + 1, Cell(s.tension_desired_base_N[j], 1, 3),
                     Cell(s.tension_desired_motor_N[j], 1, 3), Cell(s.tension_measured_N[j], 1, 3),
                     Cell(s.displacement_desired_m[j], 1e3, 3), Cell(s.displacement_m[j], 1e3, 3),
                     Cell(s.torque_measured_Nm[j], 1e3, 3));
  }
  return t;
}

nlohmann::json ToJson(const tendril_lcm::statistics_t& s) {
  const auto latency = [&s](const std::vector<std::int64_t>& counts, const std::int64_t(&at)[4]) {
    return nlohmann::json{{"median_ns", at[0]},
                          {"p99_ns", at[1]},
                          {"p999_ns", at[2]},
                          {"max_ns", at[3]},
                          {"bin_below_ns", s.bin_below_ns},
                          {"counts", counts}};
  };
  nlohmann::json misses = nlohmann::json::array();
  for (std::size_t i = 0; i < s.miss_cycle.size(); ++i) {
    misses.push_back(
        {{"cycle", s.miss_cycle[i]}, {"skipped", s.miss_skipped[i]}, {"cause", s.miss_cause[i]}});
  }
  nlohmann::json drives = nlohmann::json::array();
  for (std::size_t i = 0; i < s.drive_node_id.size(); ++i) {
    drives.push_back({{"node_id", s.drive_node_id[i]},
                      {"serial", s.drive_serial[i]},
                      {"state", StateText(s.drive_state[i])},
                      {"statusword", s.drive_statusword[i]},
                      {"error_code", s.drive_error_code[i]}});
  }
  nlohmann::json fault;
  if (s.last_fault_utime != 0) {
    fault = {{"utime", s.last_fault_utime}, {"status", s.last_fault_status}, {"text", s.last_fault_text}};
  }
  return {{"utime", s.utime},
          {"drives", drives},
          {"last_fault", fault},
          {"messages_ignored", s.messages_ignored},
          {"publish_failed", s.publish_failed},
          {"cycles", s.cycles},
          {"deadline_misses", s.deadline_misses},
          {"wake_latency", latency(s.wake_latency_counts, s.wake_latency_ns)},
          {"compute", latency(s.compute_counts, s.compute_ns)},
          {"round_trip", latency(s.round_trip_counts, s.round_trip_ns)},
          {"misses", misses},
          {"can",
           {{"sent", s.can_sent},
            {"received", s.can_received},
            {"send_refused", s.can_send_refused},
            {"receive_dropped", s.can_receive_dropped},
            {"error_frames", s.can_error_frames},
            {"bus_off", s.can_bus_off},
            {"malformed", s.can_malformed},
            {"foreign", s.can_foreign},
            {"load", s.bus_load}}},
          {"drive_age_cycles", s.drive_age_cycles},
          {"drive_worst_age_cycles", s.drive_worst_age_cycles},
          {"voluntary_switches", s.voluntary_switches},
          {"involuntary_switches", s.involuntary_switches},
          {"minor_faults", s.minor_faults},
          {"major_faults", s.major_faults}};
}

// One row of a histogram as bars: a digit a bin, the tenth part of the fullest in powers of ten.
std::string Bars(const std::vector<std::int64_t>& counts) {
  std::string bars;
  for (const std::int64_t count : counts) {
    bars += count == 0 ? '.' : static_cast<char>('0' + std::min(9, static_cast<int>(std::log10(count))));
  }
  return bars;
}

std::string Table(const tendril_lcm::statistics_t& s, const std::optional<Subject>& subject) {
  std::string t =
      fmt::format("\n{:<12}{:>11}{:>13}{:>13}   {}\n", "drive", "node", "serial", "state", "error");
  for (std::size_t i = 0; i < s.drive_node_id.size(); ++i) {
    t += fmt::format("  {:<10}{:>11}{:>13}{:>13}   {}\n", i + 1, s.drive_node_id[i], s.drive_serial[i],
                     StateText(s.drive_state[i]),
                     ErrorText(s.drive_error_code[i], s.drive_node_id[i], subject));
  }
  t += "last fault: ";
  t += s.last_fault_utime == 0
           ? "none since start\n"
           : fmt::format("{}, {} {}\n", TimeText(s.last_fault_utime), s.last_fault_status, s.last_fault_text);
  t += fmt::format("\n{:<12}{:>11}{:>11}{:>11}{:>11}   {}\n", "time [us]", "median", "99 %", "99.9 %", "most",
                   "cycles in bins below 1, 2, 4 us ... 1 s (digit d: 10^d or more)");
  const auto row = [&t](const char* name, const std::int64_t(&at)[4],
                        const std::vector<std::int64_t>& counts) {
    t += fmt::format("{:<12}", name);
    for (const std::int64_t value : at) t += Cell(static_cast<double>(value), 1e-3, 1);
    t += "   " + Bars(counts) + "\n";
  };
  row("  wake-up", s.wake_latency_ns, s.wake_latency_counts);
  row("  bus", s.round_trip_ns, s.round_trip_counts);
  row("  step", s.compute_ns, s.compute_counts);
  t += fmt::format("cycles {}, missed {}", s.cycles, s.deadline_misses);
  if (s.num_misses > 0) {
    t += fmt::format("; last: {} before cycle {} ({})", s.miss_skipped.back(), s.miss_cycle.back(),
                     s.miss_cause.back());
  }
  t += fmt::format(
      "\nCAN {:.1f} % load, {} sent, {} received, {} refused, {} dropped, {} error frames, {} times "
      "bus-off, {} malformed, {} foreign\n",
      100 * s.bus_load, s.can_sent, s.can_received, s.can_send_refused, s.can_receive_dropped,
      s.can_error_frames, s.can_bus_off, s.can_malformed, s.can_foreign);
  t += "age of feedback [cycles], now (worst of the last second):";
  for (std::size_t i = 0; i < s.drive_age_cycles.size(); ++i) {
    t += fmt::format(" {} ({})", s.drive_age_cycles[i], s.drive_worst_age_cycles[i]);
  }
  t += fmt::format("\nLCM: {} messages ignored, {} not sent", s.messages_ignored, s.publish_failed);
  t += fmt::format("\nthread: {} voluntary, {} involuntary switches, {} + {} page faults\n",
                   s.voluntary_switches, s.involuntary_switches, s.minor_faults, s.major_faults);
  return t;
}

std::string Table(const Subject& s) {
  return fmt::format("robot {} on {} ({})\n", s.robot.empty() ? "?" : s.robot, s.bus.empty() ? "?" : s.bus,
                     s.daemon);
}

void Show(const StatusOptions& o, const std::optional<Subject>& subject, const tendril_lcm::state_t& state,
          const std::optional<tendril_lcm::statistics_t>& statistics, const std::string& footer) {
  if (o.json) {
    nlohmann::json all = ToJson(state);
    if (subject) all["robot"] = subject->robot;
    if (subject) all["bus"] = subject->bus;
    if (subject) all["daemon"] = subject->daemon;
    if (statistics) all["statistics"] = ToJson(*statistics);
    fmt::print("{}\n", all.dump());
  } else {
    const bool redraw = o.watch && isatty(STDOUT_FILENO) != 0;
    fmt::print("{}{}{}{}{}", redraw ? kClearScreen : "", subject ? Table(*subject) : "", Table(state),
               statistics ? Table(*statistics, subject) : "", footer);
  }
  std::fflush(stdout);
}

void Status(const StatusOptions& o) {
  io::Client client(o.lcm.url, o.lcm.prefix);
  const MonotonicClock clock;
  bool heard = false;
  TimeNs heard_ns = clock.Now();
  tendril_lcm::state_t state{};
  std::string last_event;
  client.OnState([&](const tendril_lcm::state_t& s) {
    heard = true;
    heard_ns = clock.Now();
    state = s;
  });
  std::optional<tendril_lcm::statistics_t> statistics;
  client.OnStatistics([&](const tendril_lcm::statistics_t& s) { statistics = s; });
  std::optional<Subject> subject;
  std::int64_t started_utime = -1;
  client.OnRun([&](const tendril_lcm::run_t& r) {
    if (r.start_utime != started_utime) subject = SubjectOf(r);
    started_utime = r.start_utime;
  });
  client.OnEvent([&](const tendril_lcm::event_t& e) { last_event = e.source + ": " + e.text; });

  const auto wait = [&](TimeNs until_ns, bool first_only) {
    while (interrupted == 0 && clock.Now() < until_ns && !(first_only && heard)) client.Handle(20);
  };
  wait(clock.Now() + static_cast<TimeNs>(kFirstWithin_s * 1e9), true);
  if (!heard) throw std::runtime_error(NobodyAnswers(o.lcm, kFirstWithin_s, client));
  if (!o.watch) {
    Show(o, subject, state, statistics, "");
    return;
  }
  std::signal(SIGINT, [](int) { interrupted = 1; });
  while (interrupted == 0) {
    const double silent_s = ToSeconds(clock.Now() - heard_ns);
    std::string footer = "\n";
    if (!last_event.empty()) footer += "last event: " + last_event + "\n";
    if (silent_s > 1) footer += fmt::format("no state for {:.0f} s: has the daemon stopped?\n", silent_s);
    Show(o, subject, state, statistics, footer);
    wait(clock.Now() + kRedrawEvery_ns, false);
  }
}

}  // namespace

void AddStatusCommand(CLI::App& app) {
  auto o = std::make_shared<StatusOptions>();
  CLI::App* status = app.add_subcommand("status", "Show what a running daemon is doing");
  AddLcmOptions(*status, o->lcm);
  status->add_flag("--watch", o->watch,
                   "keep updating, five times a second, until interrupted; with robot, bus, drives (state, "
                   "error, serial), last fault and timing, which the daemon publishes once a second");
  status->add_flag("--json", o->json, "one JSON object a line instead of a table");
  status->callback([o] { Status(*o); });
}

}  // namespace tendril::tools
