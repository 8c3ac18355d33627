// Three emulated drives on a bus in memory, as the rig's configuration wants them. Test use only.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tendril/can/memory_bus.h"
#include "tendril/config/config.h"
#include "tendril/daemon/wiring.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::daemon {

inline RobotParameters RigRobot() {
  return config::LoadRobot(std::string(TENDRIL_SOURCE_DIR) + "/config/robots/rig_60mm.yaml");
}

inline DaemonParameters RigDaemon() {
  DaemonParameters p = config::LoadDaemon(std::string(TENDRIL_SOURCE_DIR) + "/config/tendrild.yaml");
  p.lcm.url = "memq://";
  p.commissioning_required = false;
  p.realtime = {};
  p.black_box.reset();  // a test that wants one says where
  // There is no motor behind these drives: their feedback never changes, whatever torque is asked for.
  p.controller.guards.max_torque_error_N = 1000;
  return p;
}

/// Serial number of the first tendon's drive; the others follow.
inline constexpr std::uint32_t kFirstSerial = 7001;

class EmulatedDrives {
 public:
  EmulatedDrives(const RobotParameters& robot, const DaemonParameters& daemon, const Clock& clock)
      : clock_(clock),
        bus_(clock),
        rack_(Drives(robot, daemon), bus_.AddPort()),
        port_(bus_.AddPort(), *this) {}

  can::MemoryBus& bus() { return bus_; }
  emulator::DriveRack& rack() { return rack_; }
  /// The master's end; the drives answer whenever it is looked at.
  can::CanPort& port() { return port_; }
  /// The master's interface is down or gone: nothing goes either way.
  void TakeDown(bool down) { down_ = down; }
  /// Load cells show the least tension from now on; until then, with no tendons there, nothing.
  void ShowTension(const RobotParameters& robot) {
    for (int i = 0; i < rack_.drives(); ++i) {
      const auto& cell = robot.actuation->tendons[static_cast<std::size_t>(i)].load_cell;
      emulator::DriveSensors sensors;
      sensors.analog_mV.fill(
          static_cast<std::int16_t>(1000 * cell.gain_VpN * (robot.limits.min_tension_N + cell.offset_N)));
      rack_.SetSensors(i, sensors);
    }
  }

 private:
  class Port final : public can::CanPort {
   public:
    Port(can::CanPort& port, EmulatedDrives& drives) : port_(port), drives_(drives) {}
    bool Send(const can::CanFrame& frame) noexcept override { return !drives_.down_ && port_.Send(frame); }
    int Receive(std::span<can::StampedFrame> frames) noexcept override {
      drives_.rack_.Poll(drives_.clock_.Now());
      const int received = port_.Receive(frames);
      return drives_.down_ ? 0 : received;
    }
    bool WaitUntil(TimeNs deadline_ns) noexcept override {
      drives_.rack_.Poll(drives_.clock_.Now());
      return port_.WaitUntil(deadline_ns);
    }
    bool up() const noexcept override { return !drives_.down_ && port_.up(); }
    bool bus_off() const noexcept override { return !drives_.down_ && port_.bus_off(); }
    void Restart() noexcept override { port_.Restart(); }
    const can::CanCounters& counters() const noexcept override { return port_.counters(); }

   private:
    can::CanPort& port_;
    EmulatedDrives& drives_;
  };

  static std::vector<emulator::EmulatedDriveParameters> Drives(const RobotParameters& robot,
                                                               const DaemonParameters& daemon) {
    std::vector<emulator::EmulatedDriveParameters> drives;
    for (const canopen::DriveSetup& setup : DriveSetups(robot, daemon.bus)) {
      emulator::EmulatedDriveParameters d;
      d.node_id = setup.node_id;
      d.serial = kFirstSerial + static_cast<std::uint32_t>(drives.size());
      d.nominal_current_mA = setup.nominal_current_mA;
      d.torque_constant_uNmpA = setup.torque_constant_uNmpA;
      d.profile = setup.profile;
      drives.push_back(d);
    }
    return drives;
  }

  const Clock& clock_;
  can::MemoryBus bus_;
  emulator::DriveRack rack_;
  bool down_ = false;
  Port port_;
};

}  // namespace tendril::daemon
