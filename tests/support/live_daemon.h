// The whole daemon in real time, the plant behind drives on a bus in memory, LCM between it and its
// operators. Knows nothing of what is asked of it.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <string>
#include <thread>

#include "tendril/can/memory_bus.h"
#include "tendril/config/config.h"
#include "tendril/daemon/daemon.h"
#include "tendril/io/connection.h"
#include "tendril/rig/virtual_rig.h"

namespace tendril::test {

/// Drives and plant answer whenever the master looks at the bus.
class LiveBus final : public can::CanPort {
 public:
  explicit LiveBus(const RobotParameters& robot)
      : bus_(clock_), rig_(robot, bus_.AddPort(), {.seed = 3}), port_(bus_.AddPort()) {}
  bool Send(const can::CanFrame& frame) noexcept override { return port_.Send(frame); }
  int Receive(std::span<can::StampedFrame> frames) noexcept override {
    rig_.Poll(clock_.Now());
    return port_.Receive(frames);
  }
  bool WaitUntil(TimeNs deadline_ns) noexcept override {
    rig_.Poll(clock_.Now());
    return port_.WaitUntil(deadline_ns);
  }
  bool up() const noexcept override { return port_.up(); }
  const can::CanCounters& counters() const noexcept override { return port_.counters(); }

 private:
  MonotonicClock clock_;
  can::MemoryBus bus_;
  rig::VirtualRig rig_;
  can::CanPort& port_;
};

inline constexpr const char* kLiveUrl = "udpm://239.255.76.67:7667?ttl=0";

/// Why nothing can be tried live on this machine now; empty when it can.
inline std::string WhyNotLive() {
  try {
    io::OpenLcm(kLiveUrl);
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  const MonotonicClock clock;
  TimeNs latest_ns = 0;
  for (int i = 0; i < 300; ++i) {
    const TimeNs due_ns = clock.Now() + kNsPerMs;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    latest_ns = std::max(latest_ns, clock.Now() - due_ns);
  }
  if (ToSeconds(latest_ns) <= 0.03) return "";
  return "this machine is too busy for real time: it wakes up to " + std::to_string(ToSeconds(latest_ns)) +
         " s late";
}

class LiveDaemon {
 public:
  /// `robot_file` in config/robots.
  LiveDaemon(const std::string& robot_file, const std::string& prefix)
      : robot_(config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/" + robot_file)),
        bus_(robot_),
        daemon_(Patient(robot_, prefix), bus_),
        thread_([this] { daemon_.Run([this] { return stop_.load(); }); }) {}
  ~LiveDaemon() {
    stop_ = true;
    thread_.join();
  }

 private:
  // Generous: the machine may be busy with other tests, and these are not about speed.
  static daemon::DaemonOptions Patient(const RobotParameters& robot, const std::string& prefix) {
    daemon::DaemonOptions options;
    options.robot = robot;
    options.parameters = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
    auto& p = options.parameters;
    p.commissioning_required = false;
    p.realtime = {};
    p.bus.heartbeat_timeout_ms = 5000;
    p.bus.sdo_timeout_ms = 2000;
    p.bus.boot_timeout_ms = 20000;
    p.bus.cycle_ns = 4 * kNsPerMs;
    p.bus.feedback_deadline_ns = 3 * kNsPerMs;
    p.controller.guards.max_missing_cycles = 50;
    p.controller.pretension_ramp_Nps = 50;
    p.lcm.url = kLiveUrl;
    p.lcm.channel_prefix = prefix;
    return options;
  }

  RobotParameters robot_;
  LiveBus bus_;
  daemon::Daemon daemon_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace tendril::test
