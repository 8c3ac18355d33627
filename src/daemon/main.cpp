// tendrild: reads the command line and the configuration, opens the bus, runs the daemon until it is asked to
// stop. Everything that can go wrong before the robot moves ends here as one line.
#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/sinks/systemd_sink.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "arguments.h"
#include "tendril/can/bus_guard.h"
#include "tendril/can/socketcan_port.h"
#include "tendril/canopen/master.h"
#include "tendril/config/config.h"
#include "tendril/core/version.h"
#include "tendril/daemon/daemon.h"
#include "tendril/daemon/foreign_sync.h"
#include "tendril/daemon/wiring.h"
#include "tendril/io/connection.h"
#include "tendril/io/gateway.h"
#include "tendril/model/held_directions.h"

namespace tendril::daemon {
namespace {

// Longer than the longest cycle worth running, so that another master's SYNC cannot be missed.
constexpr TimeNs kListenForSync_ns = 250 * kNsPerMs;
// A daemon tells once a second which one it is.
constexpr TimeNs kListenForDaemons_ns = 1500 * kNsPerMs;
constexpr std::chrono::milliseconds kLookAgain{250};
constexpr TimeNs kTellWaiting_ns = kNsPerS;

// Where the configuration has none and the command line asks for one.
constexpr double kBlackBoxSeconds = 10;

volatile std::sig_atomic_t hangups = 0, stops = 0;
std::atomic<Daemon*> running = nullptr;

// Straight to the control loop: a log that blocks must not keep the robot under tension.
void OnSignal(int) {
  stops = 1;
  if (Daemon* daemon = running.load()) daemon->RequestStop();
}
void OnHangup(int) { hangups = hangups + 1; }

// Asked about once a millisecond.
bool RefuseHangups() {
  if (hangups > 0) {
    hangups = 0;
    if (Daemon* daemon = running.load()) {
      daemon->Log(Status::kDegraded,
                  "SIGHUP refused: limits and guards of a robot under tension are not exchanged; disarm and "
                  "restart the daemon to read its files anew");
    }
  }
  return false;
}

// Before anything is controlled: true when there is nothing left to wait for, because it is to stop.
bool StopsBeforeItRuns() {
  if (hangups > 0) {
    hangups = 0;
    spdlog::warn("daemon: SIGHUP refused: restart the daemon to read its files anew");
  }
  return stops != 0;
}

// What is not there yet and may come: the interface, that it is up, a route for LCM.
bool MayCome(const std::error_code& code) {
  return code == std::errc::no_such_device || code == std::errc::network_down ||
         code == std::errc::network_unreachable;
}

// From the time on that it waits a service counts as started; until its cycle runs it is watched as well.
void FeedWatchdog() { sd_notify(0, "WATCHDOG=1"); }

// Why something that may come is not there; empty: it is.
template <class Open>
std::string Missing(const Open& open) {
  try {
    open();
    return {};
  } catch (const std::system_error& e) {
    if (!MayCome(e.code())) throw;
    return e.what();
  }
}

// A service that is started with its computer is there before its networks are: it waits for them, ready to
// be stopped, and says for what, to its operators too where LCM is there.
void WaitForNetworks(const std::string& interface, const LcmParameters& lcm) {
  const MonotonicClock clock;
  std::optional<io::Gateway> gateway;
  std::string told;
  for (TimeNs tell_ns = 0;;) {
    std::string missing = Missing([&] { can::SocketCanPort{interface}; });
    const std::string route = Missing([&] {
      io::OpenLcm(lcm.url);
      if (!gateway) gateway.emplace(lcm, io::RobotShape{}, clock);
    });
    if (missing.empty() && route.empty()) return;
    missing += (missing.empty() || route.empty() ? "" : "; and ") + route;
    if (told != missing) {
      told = missing;
      spdlog::warn("waiting: {}", told);
      sd_notify(0, fmt::format("READY=1\nSTATUS=waiting: {}", told).c_str());
      tell_ns = 0;
    }
    if (gateway && clock.Now() >= tell_ns) {
      tell_ns = clock.Now() + kTellWaiting_ns;
      gateway->PublishEvent(clock.Now(), Status::kDegraded, "daemon", "waiting: " + told);
    }
    if (gateway) gateway->Handle(0);  // commands: nobody takes them yet
    if (StopsBeforeItRuns()) return;
    std::this_thread::sleep_for(kLookAgain);
    FeedWatchdog();
  }
}

DaemonOptions Load(const Arguments& arguments) {
  DaemonOptions options;
  options.parameters = config::LoadDaemon(arguments.config);
  options.robot = config::LoadRobot(options.parameters.robot_file);
  config::CheckTogether(options.parameters, options.robot, arguments.config);
  if (!arguments.can.empty()) options.parameters.bus.interface = arguments.can;
  if (!arguments.lcm.empty()) options.parameters.lcm.url = arguments.lcm;
  if (arguments.simulated) options.parameters.commissioning_required = false;
  // Relative paths count from where the daemon was started, and the log tells where that was.
  if (!arguments.log.empty()) options.log_path = std::filesystem::absolute(arguments.log).string();
  if (!arguments.black_box.empty()) {
    auto& box = options.parameters.black_box;
    if (!box) box.emplace().seconds = kBlackBoxSeconds;
    box->folder = std::filesystem::absolute(arguments.black_box).string();
  }
  return options;
}

void LogSettings(const DaemonOptions& o, const std::string& config_path) {
  const DaemonParameters& p = o.parameters;
  std::string nodes;
  const std::vector<canopen::DriveSetup> drives = DriveSetups(o.robot, p.bus);
  const std::vector<int> driven = o.robot.actuation->DrivenTendons();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    nodes += fmt::format("{}{} -> tendon {}", nodes.empty() ? "" : ", ", drives[i].node_id, driven[i] + 1);
    if (const canopen::DriveProfile& drive = *drives[i].profile; !drive.file.empty())
      nodes += fmt::format(" ({} by {})", drive.name, drive.file);
  }
  spdlog::info("tendrild {} ({}), configuration {}", Version(), GitRevision(), config_path);
  spdlog::info("robot {} ({}): {} section(s), {} units, {} tendons, {:.0f} mm", o.robot.name, p.robot_file,
               o.robot.body.sections.size(), o.robot.body.units(), o.robot.body.tendons(),
               1e3 * o.robot.body.length_m());
  spdlog::info("bus {}: {} bit/s, cycle {:g} ms, worst-case load {:.0f} %, nodes {}", p.bus.interface,
               p.bus.bitrate_bps, static_cast<double>(p.bus.cycle_ns) / 1e6,
               100 * canopen::ComputeBusBudget(p.bus, drives).load, nodes);
  spdlog::info("controller: Capstan compensation {}, default speed {:g} rad/s",
               p.controller.capstan_compensation ? "on" : "off", p.controller.trajectory.default_speed_radps);
  spdlog::info("real time: priority {}, cpu {}, memory {}, {}", p.realtime.priority,
               p.realtime.cpu < 0 ? "any" : std::to_string(p.realtime.cpu),
               p.realtime.lock_memory ? "locked" : "not locked",
               p.realtime.required ? "required" : "not required");
  spdlog::info("LCM {}, channels {}_*; state every {}, cycle every {} cycle(s); log {}", p.lcm.url,
               p.lcm.channel_prefix, p.lcm.state_every_cycles, p.lcm.cycle_every_cycles,
               o.log_path.empty() ? "none" : o.log_path);
  for (const std::string& line : config::Warnings(p, o.robot, config_path)) spdlog::warn("{}", line);
  if (const std::string held = model::HeldDirections(o.robot.body); !held.empty())
    spdlog::info("{}: {}; goals elsewhere go to the nearest that is held (112)", o.robot.name, held);
  if (p.black_box) {
    spdlog::info("black box: {:g} s before a fault into {}", p.black_box->seconds, p.black_box->folder);
  } else {
    spdlog::info("black box: none");
  }
}

bool UnderJournal() { return std::getenv("JOURNAL_STREAM") != nullptr; }

void SetUpMessages() {
  // A terminal may have inherited the variable from a service: it counts where it names our own stream.
  struct stat own {};
  if (UnderJournal() && (fstat(STDERR_FILENO, &own) != 0 ||
                         fmt::format("{}:{}", own.st_dev, own.st_ino) != std::getenv("JOURNAL_STREAM"))) {
    unsetenv("JOURNAL_STREAM");
  }
  // The journal keeps time and priority as fields of their own.
  spdlog::set_default_logger(UnderJournal() ? spdlog::systemd_logger_mt("tendrild", "tendrild")
                                            : spdlog::stderr_color_mt("tendrild"));
  if (!UnderJournal()) spdlog::set_pattern("%Y-%m-%d %H:%M:%S.%e %^%l%$: %v");
}

// What a log of that name holds may be how an earlier run ended.
void KeepEarlierLog(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error) || std::filesystem::file_size(path, error) == 0) return;
  for (int k = 1;; ++k) {
    const std::string kept = fmt::format("{}.{}", path, k);
    if (std::filesystem::exists(kept, error)) continue;
    std::filesystem::rename(path, kept, error);
    if (error) {
      throw std::runtime_error(fmt::format(
          "--log {}: is there already and cannot be renamed ({}); name another file", path, error.message()));
    }
    spdlog::info("daemon: {} was there already: it is {} now", path, kept);
    return;
  }
}

void HandleSignals() {
  struct sigaction action {};
  action.sa_handler = OnSignal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  // With its terminal a daemon loses its operator; a service is only asked to read its files again.
  if (isatty(STDIN_FILENO) == 0) action.sa_handler = OnHangup;
  sigaction(SIGHUP, &action, nullptr);
}

void Run(const Arguments& arguments) {
  const DaemonOptions options = Load(arguments);
  const std::string& interface = options.parameters.bus.interface;

  HandleSignals();
  if (arguments.wait) WaitForNetworks(interface, options.parameters.lcm);
  if (StopsBeforeItRuns()) return spdlog::info("daemon: stopped before it controlled anything");
  const can::BusGuard guard("tendrild", interface);
  can::SocketCanPort port(interface);
  const MonotonicClock clock;
  RefuseForeignSync(port, clock, interface, kListenForSync_ns);
  Daemon daemon(options, port);
  FeedWatchdog();
  daemon.RefuseOthers(kListenForDaemons_ns);
  FeedWatchdog();
  if (StopsBeforeItRuns()) return spdlog::info("daemon: stopped before it controlled anything");
  // Not before it is known that no other daemon is writing it.
  KeepEarlierLog(options.log_path);
  LogSettings(options, arguments.config);

  struct Running {
    explicit Running(Daemon* daemon) { running = daemon; }
    ~Running() { running = nullptr; }
  } const known(&daemon);
  if (stops != 0) daemon.RequestStop();  // came in between
  daemon.Run(RefuseHangups);
}

int Main(int argc, char** argv) {
  Arguments arguments;
  const std::unique_ptr<CLI::App> app = MakeApp(arguments);
  try {
    app->parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app->exit(e) == 0 ? 0 : 2;
  }
  SetUpMessages();
  // Whoever read the log may go away; the robot is still to be stopped in order.
  std::signal(SIGPIPE, SIG_IGN);
  try {
    Run(arguments);
  } catch (const std::exception& e) {
    // By the stream, which the journal knows to be this unit's even when the process is already gone; <3> is
    // an error's priority.
    fmt::print(stderr, "{}tendrild: {}\n", UnderJournal() ? "<3>" : "", e.what());
    return 1;
  }
  return 0;
}

}  // namespace
}  // namespace tendril::daemon

int main(int argc, char** argv) {
  const int code = tendril::daemon::Main(argc, argv);
  std::cout.flush();
  // A thread that a log still holds up must find everything in its place to the last.
  std::quick_exit(code);
}
