// tendril rt-check: is this PC punctual enough for a daemon file, measured before the robot is on, and which
// settings to change if not. Touches neither bus nor robot.
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "commands.h"
#include "number_option.h"
#include "paths.h"
#include "stop_signals.h"
#include "tendril/config/config.h"
#include "tendril/rt/compare.h"
#include "tendril/rt/fitness.h"
#include "tendril/rt/host.h"

namespace tendril::tools {
namespace {

struct Options {
  std::string config, root;
  double seconds = 10;
  bool json = false;
};

double Us(TimeNs t_ns) { return static_cast<double>(t_ns) * 1e-3; }

nlohmann::json ToJson(const rt::Histogram& h, std::uint64_t missed) {
  return {{"cycles", h.count()},
          {"missed", missed},
          {"p50_us", Us(h.Percentile(0.5))},
          {"p99_us", Us(h.Percentile(0.99))},
          {"p999_us", Us(h.Percentile(0.999))},
          {"max_us", Us(h.max_ns())}};
}

double Ratio(const rt::LoopComparison& m) {
  const auto timer_ns = static_cast<double>(m.timer.Percentile(0.999));
  return timer_ns > 0 ? static_cast<double>(m.loop.Percentile(0.999)) / timer_ns : 0;
}

void PrintJson(const DaemonParameters& daemon, const rt::LoopComparison& m,
               const std::vector<rt::HostSetting>& settings, const rt::Judgement& j) {
  nlohmann::json list = nlohmann::json::array();
  for (const rt::HostSetting& s : settings) {
    list.push_back({{"name", s.name},
                    {"verdict", rt::VerdictText(s.verdict)},
                    {"value", s.value},
                    {"remedy", s.remedy}});
  }
  const nlohmann::json all{{"fit", j.fit},
                           {"reasons", j.reasons},
                           {"not_judged", j.limit},
                           {"cycle_us", Us(daemon.bus.cycle_ns)},
                           {"priority", daemon.realtime.priority},
                           {"cpu", daemon.realtime.cpu},
                           {"rights", m.problems.empty()},
                           {"loop", ToJson(m.loop, m.loop_missed)},
                           {"timer", ToJson(m.timer, m.timer_missed)},
                           {"p999_ratio", Ratio(m)},
                           {"settings", list}};
  fmt::print("{}\n", all.dump(2));
}

void PrintText(const DaemonParameters& daemon, const rt::LoopComparison& m,
               const std::vector<rt::HostSetting>& settings, const rt::Judgement& j) {
  fmt::print("cycle {:.0f} us, priority {}, CPU {}\n\n", Us(daemon.bus.cycle_ns), daemon.realtime.priority,
             daemon.realtime.cpu < 0 ? "any" : std::to_string(daemon.realtime.cpu));
  fmt::print("{:<14}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}\n", "late by [us]", "cycles", "median", "99 %",
             "99.9 %", "most", "missed");
  const auto row = [](const char* name, const rt::Histogram& h, std::uint64_t missed) {
    fmt::print("{:<14}{:>10}{:>10.1f}{:>10.1f}{:>10.1f}{:>10.1f}{:>10}\n", name, h.count(),
               Us(h.Percentile(0.5)), Us(h.Percentile(0.99)), Us(h.Percentile(0.999)), Us(h.max_ns()),
               missed);
  };
  row("  our loop", m.loop, m.loop_missed);
  row("  bare timer", m.timer, m.timer_missed);
  fmt::print("our loop / bare timer at 99.9 %: {:.2f}\n\n", Ratio(m));
  for (const rt::HostSetting& s : settings) {
    fmt::print("{:<16}{:<17}{}\n", s.name, rt::VerdictText(s.verdict), s.value);
    if (!s.remedy.empty()) fmt::print("{:<33}-> {}\n", "", s.remedy);
  }
  fmt::print("\n{} for a cycle of {:.0f} us\n", j.fit ? "fit" : "not fit", Us(daemon.bus.cycle_ns));
  for (const std::string& reason : j.reasons) fmt::print("  {}\n", reason);
  if (!j.limit.empty()) fmt::print("  {}\n", j.limit);
}

void Run(const Options& o) {
  const DaemonParameters daemon =
      config::LoadDaemon(o.config.empty() ? ConfigFile("tendrild.yaml") : o.config);
  const auto settings =
      rt::ReadHost(o.root, daemon.realtime, daemon.bus.interface, static_cast<int>(daemon.bus.nodes.size()));
  const std::atomic<bool>& stop = CatchStopSignals();
  const rt::LoopComparison measured =
      rt::CompareLoops(daemon.realtime, daemon.bus.cycle_ns, static_cast<TimeNs>(o.seconds * 1e9),
                       [&stop] { return stop.load(); });
  const rt::Judgement j = rt::Judge(daemon.bus.cycle_ns, measured, settings);
  (o.json ? PrintJson : PrintText)(daemon, measured, settings, j);
  if (!j.fit) {
    throw std::runtime_error(
        fmt::format("this machine is not fit for a cycle of {:.0f} us", Us(daemon.bus.cycle_ns)));
  }
}

}  // namespace

void AddRtCheckCommand(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand("rt-check",
                                     "Check, before the robot is on, whether this PC is punctual enough for "
                                     "the control cycle, and what to change if not");
  sub->add_option(
         "--config", options->config,
         "daemon file with cycle, priority, CPU and interface (default: the one installed with the programs)")
      ->option_text("FILE");
  sub->add_option("--seconds", options->seconds,
                  "how long to measure; prefer an hour under load to ten seconds")
      ->check(NumberFrom(0.1, 86400, "give seconds"))
      ->capture_default_str();
  sub->add_flag("--json", options->json, "one JSON object instead of a table");
  sub->add_option("--root", options->root,
                  "read settings from DIR/proc and DIR/sys instead of this machine's")
      ->check(CLI::ExistingDirectory)
      ->option_text("DIR");
  sub->footer(
      "Run it as the user and on the CPUs that tendrild has. Exit status: 0 fit, 1 not fit, 2 wrong use.");
  sub->callback([options] { Run(*options); });
}

}  // namespace tendril::tools
