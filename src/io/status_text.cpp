// Each message has its table and its JSON object here; what a table shows is a person's choice, the object
// has every field.
#include "tendril/io/status_text.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <nlohmann/json.hpp>
#include <vector>

#include "tendril/core/status.h"

namespace tendril::io {
namespace {

/// With what the code means to its kind of drive, where that is known.
std::string ErrorText(int code, int node_id, const std::optional<DaemonSubject>& subject) {
  if (code == 0) return "none";
  std::string text = fmt::format("0x{:04X}", code);
  if (!subject || !subject->error_meaning) return text;
  const std::optional<std::string> meaning =
      subject->error_meaning(node_id, static_cast<std::uint16_t>(code));
  return meaning ? text + " " + *meaning : text;
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
                      {"state", DriveStateText(s.drive_state[i])},
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

std::string Table(const tendril_lcm::statistics_t& s, const std::optional<DaemonSubject>& subject) {
  std::string t =
      fmt::format("\n{:<12}{:>11}{:>13}{:>13}   {}\n", "drive", "node", "serial", "state", "error");
  for (std::size_t i = 0; i < s.drive_node_id.size(); ++i) {
    t += fmt::format("  {:<10}{:>11}{:>13}{:>13}   {}\n", i + 1, s.drive_node_id[i], s.drive_serial[i],
                     DriveStateText(s.drive_state[i]),
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
std::string Table(const DaemonSubject& s) {
  return fmt::format("robot {} on {} ({})\n", s.robot.empty() ? "?" : s.robot, s.bus.empty() ? "?" : s.bus,
                     s.daemon);
}

}  // namespace

std::string_view DriveStateText(int state) {
  constexpr std::array kTexts = {"offline", "booting",     "ready",        "enabled",       "quick stop",
                                 "fault",   "unreachable", "other device", "misconfigured", "id twice"};
  return state >= 0 && state < static_cast<int>(kTexts.size()) ? kTexts[static_cast<std::size_t>(state)]
                                                               : "?";
}

std::string StatusTable(const DaemonStatus& status) {
  return (status.subject ? Table(*status.subject) : "") + Table(status.state) +
         (status.statistics ? Table(*status.statistics, status.subject) : "");
}

std::string StatusJson(const DaemonStatus& status) {
  nlohmann::json all = ToJson(status.state);
  if (status.subject) {
    all["robot"] = status.subject->robot;
    all["bus"] = status.subject->bus;
    all["daemon"] = status.subject->daemon;
  }
  if (status.statistics) all["statistics"] = ToJson(*status.statistics);
  return all.dump();
}

std::string NobodyAnswersText(const std::string& url, const std::string& channel_prefix, double within_s,
                              const std::string& waits) {
  if (!waits.empty()) return fmt::format("the daemon does not control anything yet, it is {}", waits);
  return fmt::format(
      "no daemon answers on {} ({}_STATE) within {:g} s; is tendrild running, with the same --lcm and "
      "--prefix?",
      url, channel_prefix, within_s);
}

}  // namespace tendril::io
