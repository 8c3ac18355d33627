// Our master alone on a CAN interface, for slaves that are no code of ours: drives 1..N until the input ends.
// The first is an EPOS4, the others too, or generic drives of an EDS file with a load cell of 2.5 mV a count.
// Orders come as lines on standard input; events and every change of a drive's state go out as lines.
#include <poll.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "support/test_bus.h"
#include "tendril/can/socketcan_port.h"
#include "tendril/canopen/master.h"

namespace {

using namespace tendril;

constexpr TimeNs kCycle_ns = 10 * kNsPerMs;

/// Times for peers written in Python, on a machine that may be busy.
BusParameters Bus(int drives) {
  BusParameters bus = canopen::TestBus(drives, kCycle_ns);
  bus.feedback_deadline_ns = 8 * kNsPerMs;
  bus.heartbeat_timeout_ms = 1000;
  bus.sdo_timeout_ms = 500;
  bus.boot_timeout_ms = 20'000;
  return bus;
}

std::vector<canopen::DriveSetup> Drives(int count, const std::string& eds) {
  std::vector<canopen::DriveSetup> drives = canopen::TestDrives(count);
  for (std::size_t i = 1; i < drives.size() && !eds.empty(); ++i) {
    NodeParameters node;
    node.node_id = drives[i].node_id;
    node.profile = DriveKind::kCia402;
    node.eds_file = eds;
    node.analog_input = "0x6401:01";
    node.analog_mV_per_count = 2.5;
    drives[i].profile = canopen::ProfileOf(node);
  }
  return drives;
}

const char* Name(DriveState state) {
  switch (state) {
    case DriveState::kOffline:
      return "offline";
    case DriveState::kBooting:
      return "booting";
    case DriveState::kReady:
      return "ready";
    case DriveState::kEnabled:
      return "enabled";
    case DriveState::kQuickStop:
      return "quick-stop";
    case DriveState::kFault:
      return "fault";
    case DriveState::kUnreachable:
      return "unreachable";
    case DriveState::kOtherDevice:
      return "other-device";
    case DriveState::kMisconfigured:
      return "misconfigured";
    case DriveState::kIdTwice:
      return "id-twice";
  }
  return "?";
}

class Program {
 public:
  Program(const std::string& interface, int drives, const std::string& eds)
      : port_(interface),
        master_(Bus(drives), Drives(drives, eds), port_),
        torques_(static_cast<std::size_t>(drives)),
        shown_(static_cast<std::size_t>(drives), DriveState::kOffline) {}

  void Run() {
    TimeNs next_ns = clock_.Now();
    master_.Start(next_ns);
    while (true) {
      std::this_thread::sleep_for(std::chrono::nanoseconds(next_ns - clock_.Now()));
      next_ns += kCycle_ns * (1 + (clock_.Now() - next_ns) / kCycle_ns);
      const TimeNs begin_ns = clock_.Now();
      master_.BeginCycle(begin_ns);
      const TimeNs deadline_ns = begin_ns + 8 * kNsPerMs;
      while (!master_.Poll(clock_.Now()) && clock_.Now() < deadline_ns) port_.WaitUntil(deadline_ns);
      master_.EndCycle(clock_.Now(), request_, torques_);
      Tell();
      pollfd input{.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
      if (poll(&input, 1, 0) <= 0) continue;
      do {  // several lines may have come at once
        std::string line;
        if (!std::getline(std::cin, line)) return;
        Obey(line);
      } while (std::cin.rdbuf()->in_avail() > 0);
    }
  }

 private:
  /// "enable", "disable", "clear", "torque PERMILLE" (of drive 1; the others its double, triple, ...).
  void Obey(const std::string& line) {
    std::istringstream words(line);
    std::string what;
    words >> what;
    if (what == "enable") request_ = DriveRequest::kEnable;
    if (what == "disable") request_ = DriveRequest::kDisable;
    if (what == "clear") master_.ClearFaults(clock_.Now());
    if (what == "torque") {
      int permille = 0;
      words >> permille;
      for (std::size_t i = 0; i < torques_.size(); ++i) {
        torques_[i] = static_cast<std::int16_t>(permille * static_cast<int>(i + 1));
      }
    }
    if (what == "feedback") {
      int drive = 0;
      words >> drive;
      const DriveFeedback& f = master_.feedback(drive);
      std::printf("feedback %d %d %d\n", f.position_counts, f.torque_permille, f.analog_mV);
      std::fflush(stdout);
    }
  }

  void Tell() {
    canopen::BusEvent event;
    while (master_.PopEvent(&event)) {
      std::printf("event %d %d %s\n", event.node_id, static_cast<int>(event.status), event.text.data());
    }
    for (int i = 0; i < master_.drives(); ++i) {
      DriveState& shown = shown_[static_cast<std::size_t>(i)];
      if (master_.feedback(i).state == shown) continue;
      shown = master_.feedback(i).state;
      std::printf("state %d %s\n", i + 1, Name(shown));
    }
    std::fflush(stdout);
  }

  const MonotonicClock clock_;
  can::SocketCanPort port_;
  canopen::Master master_;
  DriveRequest request_ = DriveRequest::kDisable;
  std::vector<std::int16_t> torques_;
  std::vector<DriveState> shown_;
};

}  // namespace

int main(int argc, char** argv) {
  std::ios::sync_with_stdio(false);  // so that lines which wait in the buffer are known of
  if (argc != 3 && argc != 4) {
    std::fprintf(stderr, "usage: %s INTERFACE DRIVES [EDS]\n", argv[0]);
    return 2;
  }
  try {
    Program(argv[1], std::stoi(argv[2]), argc == 4 ? argv[3] : "").Run();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
  return 0;
}
