// Controller, CANopen master, drive emulators, plant and LCM in one process and simulated time: the same
// frames and messages as on a robot PC, deterministic, faster than real time.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "tendril/can/memory_bus.h"
#include "tendril/canopen/master.h"
#include "tendril/control/controller.h"
#include "tendril/core/cycle.h"
#include "tendril/daemon/control_cycle.h"
#include "tendril/io/client.h"
#include "tendril/io/gateway.h"
#include "tendril/io/log.h"
#include "tendril/rig/virtual_rig.h"

namespace tendril::experiment {

struct ClosedLoopOptions {
  RobotParameters controller_robot;  // model of the controller
  RobotParameters plant_robot;       // model of the plant
  DaemonParameters daemon;           // bus.nodes are adapted to the robot, the cycle to the bus
  sim::PlantOptions plant;
  std::string log_path;     // empty: no log
  bool keep_nodes = false;  // keep the nodes of `daemon`, which must fit the robot
};

class ClosedLoop {
 public:
  /// Throws the exceptions of its parts; nothing has moved yet.
  explicit ClosedLoop(const ClosedLoopOptions& options);

  /// One control cycle with all its parts.
  const CycleRecord& Step();
  const CycleRecord& record() const { return record_; }

  TimeNs now_ns() const { return clock_.Now(); }
  double now_s() const { return ToSeconds(clock_.Now()); }
  TimeNs cycle_ns() const { return daemon_.bus.cycle_ns; }
  const DaemonParameters& daemon() const { return daemon_; }
  std::span<const canopen::DriveSetup> drive_setups() const { return setups_; }
  /// How far ahead of its time a moving target must be sent to a controller without look-ahead.
  double sender_lead_s() const {
    return daemon_.controller.trajectory.look_ahead ? 0 : ToSeconds(controller_->look_ahead_ns());
  }
  const sim::Plant& plant() const { return rig_->plant(); }
  /// For changes to the drives' wiring, before the first step.
  rig::VirtualRig& rig() { return *rig_; }
  const can::CanCounters& bus() const { return bus_.totals(); }
  std::uint64_t log_events() const { return log_ ? log_->events() : 0; }
  const io::Gateway& gateway() const { return *gateway_; }

  // ---- the operator: real LCM messages on the same connection ----

  void Send(ModeRequest request);
  /// Sends a target with the next sequence number, valid for 0.1 s.
  void Send(Command target);

  /// Steps until the condition holds; throws std::runtime_error naming `what` and the controller's status
  /// after timeout_s of simulated time.
  template <class Condition>
  void StepUntil(Condition condition, double timeout_s, const char* what) {
    const TimeNs end_ns = now_ns() + static_cast<TimeNs>(timeout_s * 1e9);
    while (!condition(Step())) {
      if (now_ns() > end_ns) ThrowTimeout(what);
    }
  }
  /// Waits for the drives to be configured, arms and pretensions; then the controller is running.
  void ArmAndPretension();
  /// The same with the motors' brakes on until the end: nothing moves before this returns.
  void ArmBehindBrakes();
  /// Changes a tracker's reading on its way to the controller; none: it is lost.
  void OnTracker(std::function<std::optional<TrackerSample>(const TrackerSample&)> way) {
    tracker_way_ = std::move(way);
  }
  /// Disarms and waits for the safe stop to end.
  void DisarmAndWait();

 private:
  [[noreturn]] void ThrowTimeout(const char* what) const;
  void ForwardEvents();
  void PublishTracker();

  SimulatedClock clock_;
  DaemonParameters daemon_;
  can::MemoryBus bus_;
  std::unique_ptr<rig::VirtualRig> rig_;
  std::vector<canopen::DriveSetup> setups_;
  std::unique_ptr<canopen::Master> master_;
  std::unique_ptr<control::Controller> controller_;
  std::unique_ptr<daemon::ControlCycle> cycle_;
  std::unique_ptr<io::Gateway> gateway_;
  std::unique_ptr<io::Client> operator_;
  std::unique_ptr<io::LogWriter> log_;
  Command pending_;
  TrackerSample tracker_;
  std::string tracker_channel_;
  std::function<std::optional<TrackerSample>(const TrackerSample&)> tracker_way_;
  CycleRecord record_;
  std::string last_event_;
  std::uint64_t cycle_count_ = 0;
  std::uint32_t sequence_ = 0;
  bool answered_ = false;
};

/// Daemon parameters with the bus adapted to the robot: one node per tendon (numbered as in the robot's file)
/// and the shortest whole-millisecond cycle within the bus budget.
DaemonParameters FitBus(DaemonParameters daemon, const RobotParameters& robot);

}  // namespace tendril::experiment
