// tendril-plant: the rig without hardware, in real time on a CAN interface. Drives answer as the robot file's
// nodes, the plant moves behind them. Knows nothing of the controller.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <string>

#include "plant_options.h"
#include "tendril/can/bus_guard.h"
#include "tendril/can/socketcan_port.h"
#include "tendril/config/config.h"
#include "tendril/emulator/faults.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"
#include "tendril/rig/fault_orders.h"
#include "tendril/rig/free_motors.h"
#include "tendril/rig/virtual_rig.h"
#include "tendril/rt/cyclic.h"
#include "tendril/sim/effects.h"

namespace tendril::tools {
namespace {

std::atomic<bool> stop_asked{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set in a signal handler");

void AskToStop(int) { stop_asked = true; }

void CatchSignals() {
  struct sigaction action {};
  action.sa_handler = AskToStop;
  sigemptyset(&action.sa_mask);
  for (const int signal : {SIGINT, SIGTERM}) sigaction(signal, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);  // whoever read its messages may go away
}

constexpr const char* kPrefix = "TENDRIL";

/// Publishes the tip as an outside tracker would see it.
class Tracker {
 public:
  explicit Tracker(lcm::LCM& lcm) : lcm_(lcm), channel_(io::ChannelName(kPrefix, "TRACKER")) {}

  /// `now_ns` is that of the rig's last poll.
  void PublishIfDue(rig::VirtualRig& rig, TimeNs now_ns) {
    const auto reading = rig.TakeTrackerReading();
    if (!reading) return;
    const auto epoch = std::chrono::system_clock::now().time_since_epoch();
    const std::int64_t utime = std::chrono::duration_cast<std::chrono::microseconds>(epoch).count() -
                               (now_ns - reading->time_ns) / kNsPerUs;
    (io::SendTracker(lcm_, channel_, *reading, utime) ? published_ : failed_)++;
  }
  std::uint64_t published() const { return published_; }
  std::uint64_t failed() const { return failed_; }

 private:
  lcm::LCM& lcm_;
  std::string channel_;
  std::uint64_t published_ = 0, failed_ = 0;
};

void Show(rig::FaultListener& listener) {
  for (const std::string& line : listener.TakeLines()) fmt::print("tendril-plant: {}\n", line);
  std::fflush(stdout);
}

/// Of the command line: what does not fit is wrong use.
template <class Work>
auto AsUse(Work work) {
  try {
    return work();
  } catch (const config::ConfigError& e) {
    throw CLI::ValidationError(e.what());
  }
}

std::vector<int> ExtraNodes(const std::string& list, const ActuationParameters& actuation) {
  if (list.empty()) return {};
  std::vector<int> taken;
  for (const auto& tendon : actuation.tendons) taken.push_back(tendon.node_id);
  try {
    return rig::ParseNodeList(list, taken);
  } catch (const std::invalid_argument& e) {
    throw CLI::ValidationError(fmt::format("--extra-nodes: {}", e.what()));
  }
}

/// What the daemon's file says of its drives.
rig::DriveProfiles Profiles(const std::string& daemon_file) {
  if (daemon_file.empty()) return {};
  return rig::DriveProfiles(config::LoadDaemon(daemon_file).bus.nodes);
}

void Run(const PlantOptions& options) {
  const std::vector<rig::FaultOrder> faults = AsUse([&] { return rig::ReadFaults(options.faults); });
  const std::vector<rig::FaultOrder> scenario =
      options.scenario.empty() ? std::vector<rig::FaultOrder>{} : rig::ReadScenario(options.scenario);
  const RobotParameters robot = sim::LoadRobot(options.robot);
  if (!robot.actuation) {
    throw std::runtime_error(
        fmt::format("{}: robot '{}' has no 'actuation' section (motors, drives, tendons); use a rig file "
                    "such as rig_90mm.yaml",
                    options.robot, robot.name));
  }
  const std::vector<int> extra = ExtraNodes(options.extra_nodes, *robot.actuation);
  const TendonDriveParameters& like = robot.actuation->tendons.front();
  const MonotonicClock clock;
  const can::BusGuard guard("tendril-plant", options.interface);
  can::SocketCanPort bus(options.interface);
  emulator::FaultInjector port(bus, options.seed);
  const rig::DriveProfiles profiles = Profiles(options.drives);
  rig::VirtualRig rig(robot, port, {.seed = options.seed}, profiles, rig::FreeDrives(extra, like));
  rig::FreeMotors free_motors(rig.drives(), static_cast<int>(robot.actuation->tendons.size()), like);
  port.Attach(rig.drives());
  AsUse([&] { rig::Order(faults, port, clock.Now()); });
  rig::Order(scenario, port, clock.Now());

  std::unique_ptr<lcm::LCM> lcm;
  std::unique_ptr<Tracker> tracker;
  std::unique_ptr<rig::FaultListener> listener;
  if (!options.lcm_url.empty()) {
    lcm = io::OpenLcm(options.lcm_url);
    listener = std::make_unique<rig::FaultListener>(*lcm, kPrefix, port, clock);
    if (robot.actuation->tracker) tracker = std::make_unique<Tracker>(*lcm);
  }

  CatchSignals();
  std::string nodes;
  for (const auto& tendon : robot.actuation->tendons) {
    nodes += fmt::format("{}{}", nodes.empty() ? "" : " ", tendon.node_id);
    if (const auto profile = profiles.Of(tendon.node_id); !profile->file.empty())
      nodes += fmt::format(" ({})", profile->name);
  }
  if (!extra.empty()) nodes += fmt::format(", free motors on nodes {}", options.extra_nodes);
  const std::string on_lcm =
      lcm ? fmt::format(", {}faults by LCM on {}", tracker ? "tracker and " : "", options.lcm_url) : "";
  const std::string ordered = port.pending() > 0 ? fmt::format(", {} faults ordered", port.pending()) : "";
  fmt::print("tendril-plant: '{}' on {}: {} units, nodes {}{}{}; ready, Ctrl-C stops\n", robot.name,
             options.interface, robot.body.units(), nodes, on_lcm, ordered);
  std::fflush(stdout);

  // Wakes for frames and at least each millisecond; the grid only bounds how long the drives and the plant
  // wait.
  const TimeNs start_ns = clock.Now();
  rt::DeadlineGrid grid(start_ns, kNsPerMs);
  rt::Histogram lag, work;
  std::uint64_t syncs = 0, skipped = 0;
  bool up = true;
  while (!stop_asked) {
    port.WaitUntil(grid.next_ns());
    const TimeNs now_ns = clock.Now();
    if (now_ns >= grid.next_ns()) {
      lag.Add(now_ns - grid.next_ns());
      skipped += grid.Advance(now_ns);
      if (lcm && io::HandleWaiting(*lcm, 0) > 0) Show(*listener);
    }
    port.Poll(now_ns);
    free_motors.Poll(now_ns);
    syncs += static_cast<std::uint64_t>(rig.Poll(now_ns));
    if (tracker) tracker->PublishIfDue(rig, now_ns);
    work.Add(clock.Now() - now_ns);
    if (port.up() != up) {
      up = !up;
      fmt::print(stderr, "tendril-plant: {} is {}\n", options.interface,
                 up ? "up again" : "down; waiting for it");
    }
  }

  const can::CanCounters& frames = bus.counters();
  const auto us = [](TimeNs ns) { return static_cast<double>(ns) * 1e-3; };
  fmt::print("tendril-plant: {:.1f} s, {} cycles (SYNC), {} frames in, {} out, {} lost\n",
             ToSeconds(clock.Now() - start_ns), syncs, frames.received, frames.sent,
             frames.send_refused + frames.receive_dropped);
  fmt::print(
      "tendril-plant: real-time lag 99 % below {:.0f} us, at most {:.0f} us, {} whole milliseconds missed; "
      "work per "
      "wake-up 99 % below {:.0f} us, at most {:.0f} us\n",
      us(lag.Percentile(0.99)), us(lag.max_ns()), skipped, us(work.Percentile(0.99)), us(work.max_ns()));
  if (const emulator::FaultCounters& f = port.faults();
      f.dropped + f.delayed + f.duplicated + f.corrupted > 0) {
    fmt::print("tendril-plant: frames by faults: {} dropped, {} delayed, {} duplicated, {} corrupted\n",
               f.dropped, f.delayed, f.duplicated, f.corrupted);
  }
  if (tracker) {
    fmt::print("tendril-plant: {} tracker messages, {} failed\n", tracker->published(), tracker->failed());
  }
}

}  // namespace
}  // namespace tendril::tools

int main(int argc, char** argv) {
  tendril::tools::PlantOptions options;
  const std::unique_ptr<CLI::App> app = tendril::tools::MakePlantApp(options);
  try {
    app->parse(argc, argv);
    tendril::tools::Run(options);
  } catch (const CLI::ParseError& e) {
    return app->exit(e) == 0 ? 0 : 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "tendril-plant: {}\n", e.what());
    return 1;
  }
  return 0;
}
