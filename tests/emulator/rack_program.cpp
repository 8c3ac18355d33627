// Emulated drives alone on a CAN interface, for peers that are no test of ours: nodes 1..N answer until the
// input ends. Knows the rack and SocketCAN; what to do comes as lines on standard input.
#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "tendril/can/socketcan_port.h"
#include "tendril/canopen/epos4.h"
#include "tendril/emulator/drive_rack.h"

namespace {

using namespace tendril;

/// "emcy D CODE", "freeze D 0|1", "power D", "mute D", "turn D COUNTS", "torque D" (answers in N·m). D counts
/// from 0.
void Obey(const std::string& line, emulator::DriveRack& rack) {
  std::istringstream words(line);
  std::string what;
  int drive = 0;
  words >> what >> drive;
  if (what == "emcy") {
    unsigned code = 0;
    words >> std::hex >> code;
    rack.InjectEmcy(drive, static_cast<std::uint16_t>(code));
  } else if (what == "freeze") {
    bool frozen = false;
    words >> frozen;
    rack.SetFrozen(drive, frozen);
  } else if (what == "power") {
    rack.PowerCycle(drive);
  } else if (what == "mute") {
    rack.StopHeartbeat(drive);
  } else if (what == "turn") {
    emulator::DriveSensors sensors;
    words >> sensors.position_counts;
    rack.SetSensors(drive, sensors);
  }
  std::printf("%.9f\n", rack.torque_Nm(drive));
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: %s INTERFACE DRIVES EDS_FILE\n", argv[0]);
    return 2;
  }
  try {
    std::ofstream(argv[3]) << canopen::EdsText();
    can::SocketCanPort port(argv[1]);
    std::vector<emulator::EmulatedDriveParameters> drives;
    for (int node = 1; node <= std::stoi(argv[2]); ++node) {
      drives.push_back({.node_id = node, .nominal_current_mA = 360, .torque_constant_uNmpA = 19600});
    }
    emulator::DriveRack rack(drives, port);
    const MonotonicClock clock;
    std::puts("ready");
    std::fflush(stdout);
    while (true) {
      port.WaitUntil(clock.Now() + kNsPerMs);
      rack.Poll(clock.Now());
      pollfd input{.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
      if (poll(&input, 1, 0) <= 0) continue;
      std::string line;
      if (!std::getline(std::cin, line)) return 0;
      Obey(line, rack);
    }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
}
