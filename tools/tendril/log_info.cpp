// tendril log info: what a log holds. Knows the command line and how it is shown; the io room reads.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "commands.h"
#include "counted.h"
#include "number_option.h"
#include "progress.h"
#include "stop_signals.h"
#include "tendril/config/config.h"
#include "tendril/core/plain_text.h"
#include "tendril/io/log_summary.h"

namespace tendril::tools {
namespace {

struct InfoOptions {
  std::string log;
  double least_gap_s = 1;
  bool json = false;
};

std::string Date(std::int64_t utime) {
  const std::time_t seconds = utime / 1'000'000;
  return fmt::format("{:%Y-%m-%d %H:%M:%S} UTC", fmt::gmtime(seconds));
}

/// Simulated time counts from near zero; no robot ran before this.
bool IsDate(std::int64_t utime) { return utime > 946'684'800'000'000; }  // of 2000

std::string RobotName(const io::RunInfo& run) {
  try {
    return config::ParseRobot(run.robot_yaml, "the log's robot").name;
  } catch (const std::exception&) {
    return {};  // of another version
  }
}

std::string TypeText(const io::ChannelSummary& channel) {
  return channel.type.empty() ? "not of this version" : channel.type;
}

void PrintRuns(const io::LogSummary& log) {
  for (const io::LoggedRun& run : log.runs) {
    const std::string robot = RobotName(run.info);
    fmt::print("{:<9} {}, Tendril {} ({}){}{}\n", PlainText(run.prefix) + ":",
               robot.empty() ? "a robot file of another version" : "robot '" + robot + "'",
               PlainText(run.info.version), PlainText(run.info.git_revision),
               IsDate(run.info.start_utime) ? ", started " + Date(run.info.start_utime) : "",
               run.info.daemon.empty() ? "" : ", " + PlainText(run.info.daemon));
  }
  if (log.runs.empty()) fmt::print("robot:    not said: no RUN message of this version\n");
}

void PrintChannels(const io::LogSummary& log) {
  fmt::print("\n{:<26} {:<20} {:>9} {:>10} {:>9} {:>10} {:>10}\n", "channel", "type", "messages",
             "rate [1/s]", "MB", "longest gap", "at [s]");
  for (const io::ChannelSummary& c : log.channels) {
    const double gap_s = c.longest.seconds();
    fmt::print("{:<26} {:<20} {:>9} {:>10.4g} {:>9.3f} {:>9.4g} s {:>10.3f}\n", PlainText(c.name),
               TypeText(c), c.messages, c.rate_per_s(), 1e-6 * static_cast<double>(c.bytes), gap_s,
               gap_s > 0 ? 1e-6 * static_cast<double>(c.longest.begin_us - log.first_us) : 0.0);
  }
}

void PrintFindings(const io::LogSummary& log, const InfoOptions& o) {
  fmt::print("\n");
  for (const io::ChannelSummary& c : log.channels) {
    if (c.missing_cycles > 0)
      fmt::print("{}: {} missing by their numbers\n", PlainText(c.name), Counted(c.missing_cycles, "cycle"));
    if (c.earlier > 0)
      fmt::print("{}: {} stamped before the one ahead\n", PlainText(c.name), Counted(c.earlier, "message"));
  }
  if (log.gaps == 0) fmt::print("no silence of {:g} s or more\n", o.least_gap_s);
  for (const io::LogGap& gap : log.first_gaps) {
    fmt::print("silence of {:.3f} s from {:.3f} s on\n", gap.seconds(),
               1e-6 * static_cast<double>(gap.begin_us - log.first_us));
  }
  if (log.gaps > log.first_gaps.size()) fmt::print("{} more silences\n", log.gaps - log.first_gaps.size());
  fmt::print("{}\n", log.damage.empty() ? "not damaged" : "damaged: " + log.damage);
}

nlohmann::json Json(const io::LogSummary& log, const std::string& path) {
  using nlohmann::json;
  json channels = json::array(), runs = json::array(), gaps = json::array();
  const auto since = [&](std::int64_t stamp) { return 1e-6 * static_cast<double>(stamp - log.first_us); };
  for (const io::ChannelSummary& c : log.channels) {
    channels.push_back(
        {{"channel", c.name},
         {"type", c.type.empty() ? json() : json(c.type)},
         {"messages", c.messages},
         {"bytes", c.bytes},
         {"rate_per_s", c.rate_per_s()},
         {"first_s", since(c.first_us)},
         {"last_s", since(c.last_us)},
         {"longest_gap_s", c.longest.seconds()},
         {"longest_gap_at_s", c.longest.end_us == 0 ? json() : json(since(c.longest.begin_us))},
         {"missing_cycles", c.missing_cycles},
         {"stamped_earlier", c.earlier}});
  }
  for (const io::LoggedRun& run : log.runs) {
    const std::string robot = RobotName(run.info);
    runs.push_back({{"prefix", run.prefix},
                    {"robot", robot.empty() ? json() : json(robot)},
                    {"version", run.info.version},
                    {"git_revision", run.info.git_revision},
                    {"start_utime", run.info.start_utime},
                    {"daemon", run.info.daemon}});
  }
  for (const io::LogGap& gap : log.first_gaps)
    gaps.push_back({{"at_s", since(gap.begin_us)}, {"seconds", gap.seconds()}});
  return {{"log", path},
          {"bytes", log.file_bytes},
          {"messages", log.messages},
          {"first_utime", log.first_us},
          {"seconds", log.seconds()},
          {"channels", channels},
          {"runs", runs},
          {"silences", log.gaps},
          {"first_silences", gaps},
          {"damage", log.damage}};
}

void Info(const InfoOptions& o) {
  const std::atomic<bool>& stop = CatchStopSignals();
  io::LogSummary log;
  {
    Progress progress;
    log = io::SummariseLog(o.log, o.least_gap_s, [&](double share) {
      if (stop) throw std::runtime_error("log info: ended by " + StoppedBy());
      progress("reading", share);
    });
  }
  if (o.json) {
    // Names of channels are whatever another program sent.
    fmt::print("{}\n", Json(log, o.log).dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
  } else {
    fmt::print("{}: {:.3f} MB, {}, {:.3f} s{}\n", o.log, 1e-6 * static_cast<double>(log.file_bytes),
               Counted(log.messages, "message"), log.seconds(),
               log.messages > 0 && IsDate(log.first_us) ? " from " + Date(log.first_us) : "");
    if (log.messages > 0) {
      PrintRuns(log);
      PrintChannels(log);
    }
    PrintFindings(log, o);
  }
  if (log.messages == 0) {
    throw std::runtime_error(o.log +
                             ": no whole message in this file; accepted: LCM logs of tendrild, tendril sim, "
                             "tendril demo or lcm-logger");
  }
}

}  // namespace

void AddLogInfoCommand(CLI::App& app) {
  auto o = std::make_shared<InfoOptions>();
  CLI::App* info = LogCommand(app).add_subcommand(
      "info", "What a log holds: robot and build, channels with counts and rates, gaps, damage by its byte");
  info->add_option("LOG", o->log, "LCM log")->required();
  info->add_option("--gap", o->least_gap_s, "shortest silence of all channels that is listed [s]")
      ->capture_default_str()
      ->option_text("S")
      ->check(NumberFrom(1e-6, 1e9, "give seconds"));
  info->add_flag("--json", o->json, "as JSON");
  info->footer("Exit status: 0 read, also where damaged, 1 no log, 2 wrong use.");
  info->callback([o] { Info(*o); });
}

}  // namespace tendril::tools
