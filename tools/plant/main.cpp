// tendril-plant: the rig without hardware, in real time on a CAN interface. Drives answer as the robot file's
// nodes, the plant moves behind them. Knows nothing of the controller.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <string>
#include <vector>

#include "plant_options.h"
#include "tendril/can/bus_guard.h"
#include "tendril/can/socketcan_port.h"
#include "tendril/config/config.h"
#include "tendril/emulator/faults.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"
#include "tendril/io/epoch.h"
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
    const std::int64_t utime = io::EpochUs() - (now_ns - reading->time_ns) / kNsPerUs;
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

/// What the command line names, read before anything touches the bus.
struct Job {
  explicit Job(const PlantOptions& options)
      : faults(AsUse([&] { return rig::ReadFaults(options.faults); })),
        scenario(options.scenario.empty() ? std::vector<rig::FaultOrder>{}
                                          : rig::ReadScenario(options.scenario)),
        robot(sim::LoadRobot(options.robot)) {
    if (!robot.actuation) {
      throw std::runtime_error(
          fmt::format("{}: robot '{}' has no 'actuation' section (motors, drives, tendons); use a rig file "
                      "such as rig_90mm.yaml",
                      options.robot, robot.name));
    }
    extra_nodes = ExtraNodes(options.extra_nodes, *robot.actuation);
  }
  const std::vector<TendonDriveParameters>& tendons() const { return robot.actuation->tendons; }

  std::vector<rig::FaultOrder> faults, scenario;
  RobotParameters robot;
  std::vector<int> extra_nodes;
};

class Plant {
 public:
  explicit Plant(const PlantOptions& options);

  void SayReady() const;
  /// Until asked to stop.
  void Serve();
  void SaySummary() const;

 private:
  void ConnectLcm();

  const PlantOptions& options_;
  const Job job_;
  const MonotonicClock clock_;
  const can::BusGuard guard_;
  can::SocketCanPort bus_;
  emulator::FaultInjector port_;
  const rig::DriveProfiles profiles_;
  rig::VirtualRig rig_;
  rig::FreeMotors free_motors_;
  std::unique_ptr<lcm::LCM> lcm_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<rig::FaultListener> listener_;
  TimeNs start_ns_ = 0;
  rt::Histogram lag_, work_;
  std::uint64_t syncs_ = 0, skipped_ = 0;
};

Plant::Plant(const PlantOptions& options)
    : options_(options),
      job_(options),
      guard_("tendril-plant", options.interface),
      bus_(options.interface),
      port_(bus_, options.seed),
      profiles_(Profiles(options.drives)),
      rig_(job_.robot, port_, {.seed = options.seed}, profiles_,
           rig::FreeDrives(job_.extra_nodes, job_.tendons().front())),
      free_motors_(rig_.drives(), job_.robot.actuation->drives(), job_.tendons().front()) {
  port_.Attach(rig_.drives());
  AsUse([&] { rig::Order(job_.faults, port_, clock_.Now()); });
  rig::Order(job_.scenario, port_, clock_.Now());
  if (!options.lcm_url.empty()) ConnectLcm();
}

void Plant::ConnectLcm() {
  lcm_ = io::OpenLcm(options_.lcm_url);
  listener_ = std::make_unique<rig::FaultListener>(*lcm_, kPrefix, port_, clock_);
  if (job_.robot.actuation->tracker) tracker_ = std::make_unique<Tracker>(*lcm_);
}

void Plant::SayReady() const {
  std::string nodes;
  for (const int j : job_.robot.actuation->DrivenTendons()) {
    const auto& tendon = job_.tendons()[static_cast<std::size_t>(j)];
    nodes += fmt::format("{}{}", nodes.empty() ? "" : " ", tendon.node_id);
    if (const auto profile = profiles_.Of(tendon.node_id); !profile->file.empty())
      nodes += fmt::format(" ({})", profile->name);
  }
  if (!job_.extra_nodes.empty()) nodes += fmt::format(", free motors on nodes {}", options_.extra_nodes);
  const std::string on_lcm =
      lcm_ ? fmt::format(", {}faults by LCM on {}", tracker_ ? "tracker and " : "", options_.lcm_url) : "";
  const std::string ordered = port_.pending() > 0 ? fmt::format(", {} faults ordered", port_.pending()) : "";
  fmt::print("tendril-plant: '{}' on {}: {} units, nodes {}{}{}; ready, Ctrl-C stops\n", job_.robot.name,
             options_.interface, job_.robot.body.units(), nodes, on_lcm, ordered);
  std::fflush(stdout);
}

// Wakes for frames and at least each millisecond; the grid only bounds how long the drives and the plant
// wait.
void Plant::Serve() {
  start_ns_ = clock_.Now();
  rt::DeadlineGrid grid(start_ns_, kNsPerMs);
  bool up = true;
  while (!stop_asked) {
    port_.WaitUntil(grid.next_ns());
    const TimeNs now_ns = clock_.Now();
    if (now_ns >= grid.next_ns()) {
      lag_.Add(now_ns - grid.next_ns());
      skipped_ += grid.Advance(now_ns);
      if (lcm_ && io::HandleWaiting(*lcm_, 0) > 0) Show(*listener_);
    }
    port_.Poll(now_ns);
    free_motors_.Poll(now_ns);
    syncs_ += static_cast<std::uint64_t>(rig_.Poll(now_ns));
    if (tracker_) tracker_->PublishIfDue(rig_, now_ns);
    work_.Add(clock_.Now() - now_ns);
    if (port_.up() != up) {
      up = !up;
      fmt::print(stderr, "tendril-plant: {} is {}\n", options_.interface,
                 up ? "up again" : "down; waiting for it");
    }
  }
}

void Plant::SaySummary() const {
  const can::CanCounters& frames = bus_.counters();
  const auto us = [](TimeNs ns) { return static_cast<double>(ns) * 1e-3; };
  fmt::print("tendril-plant: {:.1f} s, {} cycles (SYNC), {} frames in, {} out, {} lost\n",
             ToSeconds(clock_.Now() - start_ns_), syncs_, frames.received, frames.sent,
             frames.send_refused + frames.receive_dropped);
  fmt::print(
      "tendril-plant: real-time lag 99 % below {:.0f} us, at most {:.0f} us, {} whole milliseconds missed; "
      "work per "
      "wake-up 99 % below {:.0f} us, at most {:.0f} us\n",
      us(lag_.Percentile(0.99)), us(lag_.max_ns()), skipped_, us(work_.Percentile(0.99)), us(work_.max_ns()));
  if (const emulator::FaultCounters& f = port_.faults();
      f.dropped + f.delayed + f.duplicated + f.corrupted > 0) {
    fmt::print("tendril-plant: frames by faults: {} dropped, {} delayed, {} duplicated, {} corrupted\n",
               f.dropped, f.delayed, f.duplicated, f.corrupted);
  }
  if (tracker_) {
    fmt::print("tendril-plant: {} tracker messages, {} failed\n", tracker_->published(), tracker_->failed());
  }
}

void Run(const PlantOptions& options) {
  Plant plant(options);
  CatchSignals();
  plant.SayReady();
  plant.Serve();
  plant.SaySummary();
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
