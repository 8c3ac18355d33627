// The whole daemon with a simulated robot in this process, as `tendril sim` runs it, LCM between it and its
// operators. Knows nothing of what is asked of it.
#pragma once

#include <atomic>
#include <string>
#include <thread>

#include "tendril/config/config.h"
#include "tendril/daemon/daemon.h"
#include "tendril/rig/simulated_robot.h"
#include "tendril/rt/paced_time.h"

namespace tendril::test {

/// In the network of tests/tools/own_network.sh.
inline constexpr const char* kLiveUrl = "udpm://239.255.76.67:7667?ttl=0";

/// At the pace of the machine; a busy one falls behind, and no cycle is missed.
class LiveDaemon {
 public:
  /// `robot_file` in config/robots.
  LiveDaemon(const std::string& robot_file, const std::string& prefix)
      : options_(Options(robot_file, prefix)),
        robot_(options_.robot, options_.parameters, time_.clock(), 3),
        daemon_(options_, robot_.port(), time_) {
    time_.AfterEachCycle([this] { robot_.Answer(); });
    thread_ = std::thread([this] { daemon_.Run([this] { return stop_.load(); }); });
  }
  ~LiveDaemon() {
    stop_ = true;
    thread_.join();
  }

 private:
  static daemon::DaemonOptions Options(const std::string& robot_file, const std::string& prefix) {
    daemon::DaemonOptions options;
    options.robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/" + robot_file);
    options.parameters = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
    options.parameters.commissioning_required = false;
    options.parameters.controller.pretension_ramp_Nps = 50;
    options.parameters.lcm.url = kLiveUrl;
    options.parameters.lcm.channel_prefix = prefix;
    return options;
  }

  daemon::DaemonOptions options_;
  rt::PacedTime time_{1};
  rig::SimulatedRobot robot_;
  daemon::Daemon daemon_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace tendril::test
