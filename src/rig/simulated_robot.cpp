#include "tendril/rig/simulated_robot.h"

#include <fmt/format.h>

#include <exception>
#include <lcm/lcm-cpp.hpp>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "tendril/can/memory_bus.h"
#include "tendril/emulator/faults.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"
#include "tendril/rig/fault_orders.h"
#include "tendril/rig/virtual_rig.h"

namespace tendril::rig {

struct SimulatedRobot::State {
  State(const RobotParameters& robot, const DaemonParameters& daemon, const Clock& robot_clock,
        std::uint64_t seed)
      : clock(robot_clock),
        bus(robot_clock),
        faults(bus.AddPort(), seed),
        rig(robot, faults, {.seed = seed}, DriveProfiles(daemon.bus.nodes)),
        lcm(io::OpenLcm(daemon.lcm.url)),
        listener(*lcm, daemon.lcm.channel_prefix, faults, robot_clock),
        tracker_channel(io::ChannelName(daemon.lcm.channel_prefix, "TRACKER")),
        port(*this) {
    faults.Attach(rig.drives());
    for (const NodeParameters& node : daemon.bus.nodes) Wire(robot, node);
  }

  /// The leads of a drive as the daemon's file says they are.
  void Wire(const RobotParameters& robot, const NodeParameters& node) {
    const std::vector<int> driven = robot.actuation->DrivenTendons();
    for (std::size_t i = 0; i < driven.size(); ++i) {
      if (robot.actuation->tendons[static_cast<std::size_t>(driven[i])].node_id != node.node_id) continue;
      rig.Connect(static_cast<int>(i),
                  {.motor_reversed = node.motor_reversed, .encoder_reversed = node.encoder_reversed});
    }
  }

  /// The daemon's end of the bus.
  class Port final : public can::CanPort {
   public:
    explicit Port(State& robot) : robot_(robot), inner_(robot.bus.AddPort()) {}
    bool Send(const can::CanFrame& frame) noexcept override { return inner_.Send(frame); }
    int Receive(std::span<can::StampedFrame> frames) noexcept override { return inner_.Receive(frames); }
    bool WaitUntil(TimeNs deadline_ns) noexcept override {
      return robot_.Answer() && inner_.WaitUntil(deadline_ns);
    }
    bool up() const noexcept override { return inner_.up(); }
    bool bus_off() const noexcept override { return inner_.bus_off(); }
    void Restart() noexcept override { inner_.Restart(); }
    const can::CanCounters& counters() const noexcept override { return inner_.counters(); }

   private:
    State& robot_;
    can::CanPort& inner_;
  };

  /// False when the robot has answered at this time already, or cannot any more.
  bool Answer() noexcept {
    const TimeNs now_ns = clock.Now();
    if (given_up || std::exchange(answered_ns, now_ns) == now_ns) return false;
    try {
      if (io::HandleWaiting(*lcm, 0) > 0) Say(listener.TakeLines());
      faults.Poll(now_ns);
      rig.Poll(now_ns);
      if (const auto reading = rig.TakeTrackerReading()) {
        io::SendTracker(*lcm, tracker_channel, *reading, reading->time_ns / kNsPerUs);
      }
    } catch (const std::exception& e) {
      // From here on its drives are silent, which the daemon treats as with any robot.
      given_up = true;
      Say({fmt::format("the simulated robot stopped: {}", e.what())});
    }
    return !given_up;
  }

  void Say(std::vector<std::string> said) {
    const std::lock_guard lock(mutex);
    lines.insert(lines.end(), said.begin(), said.end());
  }

  const Clock& clock;
  can::MemoryBus bus;
  emulator::FaultInjector faults;
  VirtualRig rig;
  std::unique_ptr<lcm::LCM> lcm;
  FaultListener listener;
  std::string tracker_channel;
  Port port;
  std::optional<TimeNs> answered_ns;
  bool given_up = false;
  std::mutex mutex;
  std::vector<std::string> lines;
};

SimulatedRobot::SimulatedRobot(const RobotParameters& robot, const DaemonParameters& daemon,
                               const Clock& clock, std::uint64_t seed)
    : state_(std::make_unique<State>(robot, daemon, clock, seed)) {}

SimulatedRobot::~SimulatedRobot() = default;

void SimulatedRobot::Answer() noexcept { state_->Answer(); }

can::CanPort& SimulatedRobot::port() { return state_->port; }

std::vector<std::string> SimulatedRobot::TakeLines() {
  const std::lock_guard lock(state_->mutex);
  return std::exchange(state_->lines, {});
}

}  // namespace tendril::rig
