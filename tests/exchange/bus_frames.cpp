// The bus of a daemon file in memory, with master and emulated drives: every frame of a start-up and some
// cycles as "ID HEX", and at its end what was put into the last cycle, a line a drive. For dbc_test.py.
#include <fmt/core.h>

#include <cstdint>
#include <vector>

#include "daemon/emulated_drives.h"
#include "tendril/canopen/cia402.h"
#include "tendril/canopen/master.h"
#include "tendril/sim/effects.h"

namespace {

using namespace tendril;

void Print(const can::CanFrame& frame) {
  fmt::print("{} ", frame.id);
  for (int i = 0; i < frame.size; ++i) fmt::print("{:02x}", frame.data[static_cast<std::size_t>(i)]);
  fmt::print("\n");
}

emulator::DriveSensors SensorsOf(int drive) {
  emulator::DriveSensors sensors;
  sensors.position_counts = -12345 + 7777 * drive;
  sensors.actual_torque_Nm = 1e-3 * (drive - 1);
  sensors.analog_mV.fill(static_cast<std::int16_t>(250 * (drive + 1)));
  return sensors;
}

void Run(const char* file) {
  const DaemonParameters parameters = config::LoadDaemon(file);
  const RobotParameters robot = sim::LoadRobot(parameters.robot_file);
  SimulatedClock clock{kNsPerS};
  daemon::EmulatedDrives drives(robot, parameters, clock);
  drives.bus().SetFilter([](can::CanFrame& frame) {
    Print(frame);
    return true;
  });
  canopen::Master master(parameters.bus, daemon::DriveSetups(robot, parameters.bus), drives.port());
  std::vector<std::int16_t> torque_permille;
  for (int i = 0; i < drives.rack().drives(); ++i) {
    drives.rack().SetSensors(i, SensorsOf(i));
    torque_permille.push_back(static_cast<std::int16_t>(100 * i - 50));
  }
  master.Start(clock.Now());
  for (int cycle = 0; cycle < 1500; ++cycle) {
    clock.Advance(parameters.bus.cycle_ns);
    master.BeginCycle(clock.Now());
    master.Poll(clock.Now());
    const bool ready = cycle > 1000;
    master.EndCycle(clock.Now(), ready ? DriveRequest::kEnable : DriveRequest::kDisable, torque_permille);
    if (cycle == 1490) {
      for (int i = 0; i < drives.rack().drives(); ++i) {
        const auto& feedback = master.feedback(i);
        fmt::print("drive {} {} {} {} {}\n", drives.rack().node_id(i),
                   torque_permille[static_cast<std::size_t>(i)], feedback.position_counts,
                   feedback.torque_permille, feedback.analog_mV);
      }
    }
  }
  drives.rack().InjectEmcy(0, 0x2310);
  master.Poll(clock.Now());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  Run(argv[1]);
}
