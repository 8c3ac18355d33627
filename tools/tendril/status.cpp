// tendril status: what a daemon is doing, once or continuously, as a table or JSON.
#include <fmt/format.h>
#include <unistd.h>

#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "commands.h"
#include "dashboard.h"
#include "lcm_options.h"
#include "stop_signals.h"
#include "tendril/canopen/drive_profile.h"
#include "tendril/canopen/emcy.h"
#include "tendril/config/config.h"
#include "tendril/core/clock.h"
#include "tendril/io/client.h"
#include "tendril/io/status_text.h"
#include "tendril/io/wire.h"
#include "tendril_lcm/event_t.hpp"
#include "tendril_lcm/run_t.hpp"

namespace tendril::tools {
namespace {

constexpr double kFirstWithin_s = 2;
constexpr TimeNs kRedrawEvery_ns = 200 * kNsPerMs;
constexpr const char* kClearScreen = "\033[H\033[J";

struct StatusOptions {
  LcmOptions lcm;
  bool watch = false, json = false, plain = false;
  DashboardOptions dashboard;
};

io::DaemonSubject SubjectOf(const tendril_lcm::run_t& message) {
  io::RunInfo run;
  io::FromMessage(message, run);
  io::DaemonSubject subject;
  subject.daemon = run.daemon;
  std::map<int, DriveKind> drives;  // by node id
  try {
    subject.robot = config::ParseRobot(run.robot_yaml, "the daemon's robot").name;
    const BusParameters bus = config::ParseDaemon(run.daemon_yaml, "the daemon's file").bus;
    subject.bus = bus.interface;
    for (const NodeParameters& node : bus.nodes) drives[node.node_id] = node.profile;
  } catch (const config::ConfigError&) {
    // Another version's files: the daemon's own line has the names.
  }
  subject.error_meaning = [drives](int node_id, std::uint16_t code) -> std::optional<std::string> {
    const auto drive = drives.find(node_id);
    if (drive == drives.end()) return std::nullopt;
    return std::string(canopen::FindEmcy(canopen::EmcyOf(drive->second), code).text);
  };
  return subject;
}

void Show(const StatusOptions& o, const io::DaemonStatus& status, const std::string& footer) {
  if (o.json) {
    fmt::print("{}\n", io::StatusJson(status));
  } else {
    const bool redraw = o.watch && isatty(STDOUT_FILENO) != 0;
    fmt::print("{}{}{}", redraw ? kClearScreen : "", io::StatusTable(status), footer);
  }
  std::fflush(stdout);
}

void Status(const StatusOptions& o) {
  if (o.watch && !o.json && !o.plain) BecomeDashboard(o.lcm, o.dashboard);
  RefuseDashboardOptions(o.dashboard);
  io::Client client(o.lcm.url, o.lcm.prefix);
  const MonotonicClock clock;
  bool heard = false;
  TimeNs heard_ns = clock.Now();
  io::DaemonStatus status;
  std::string last_event;
  client.OnState([&](const tendril_lcm::state_t& s) {
    heard = true;
    heard_ns = clock.Now();
    status.state = s;
  });
  client.OnStatistics([&](const tendril_lcm::statistics_t& s) { status.statistics = s; });
  std::int64_t started_utime = -1;
  client.OnRun([&](const tendril_lcm::run_t& r) {
    if (r.start_utime != started_utime) status.subject = SubjectOf(r);
    started_utime = r.start_utime;
  });
  client.OnEvent([&](const tendril_lcm::event_t& e) { last_event = e.source + ": " + e.text; });

  const std::atomic<bool>& stop = CatchStopSignals();
  const auto wait = [&](TimeNs until_ns, bool first_only) {
    while (!stop && clock.Now() < until_ns && !(first_only && heard)) client.Handle(20);
  };
  wait(clock.Now() + static_cast<TimeNs>(kFirstWithin_s * 1e9), true);
  if (stop) throw std::runtime_error("interrupted");
  if (!heard) throw std::runtime_error(NobodyAnswers(o.lcm, kFirstWithin_s, client));
  if (!o.watch) {
    Show(o, status, "");
    return;
  }
  while (!stop) {
    const double silent_s = ToSeconds(clock.Now() - heard_ns);
    std::string footer = "\n";
    if (!last_event.empty()) footer += "last event: " + last_event + "\n";
    if (silent_s > 1) footer += fmt::format("no state for {:.0f} s: has the daemon stopped?\n", silent_s);
    Show(o, status, footer);
    wait(clock.Now() + kRedrawEvery_ns, false);
  }
}

}  // namespace

void AddStatusCommand(CLI::App& app) {
  auto o = std::make_shared<StatusOptions>();
  CLI::App* status = app.add_subcommand("status", "Show what a running daemon is doing");
  AddOperatorOptions(*status, o->lcm);
  status->add_flag(
      "--watch", o->watch,
      "keep updating until interrupted, with robot, bus, drives (state, error, serial), last fault "
      "and timing, which the daemon publishes once a second; on a terminal, with the Python package "
      "(pip install './python[dashboard]'), as a dashboard that also arms, jogs and disarms");
  status->add_flag("--plain", o->plain, "with --watch: the table, five times a second, also on a terminal");
  status->add_flag("--json", o->json, "one JSON object a line instead of a table");
  AddDashboardOptions(*status, o->dashboard);
  status->callback([o] { Status(*o); });
}

}  // namespace tendril::tools
