// The whole cycle (master, controller, record, hand-off, black box) allocates nothing, from boot to motion;
// nor do the bus in memory and the drives emulated on it, which run on the same thread here.
#include <gtest/gtest.h>

#include <vector>

#include "emulated_drives.h"
#include "support/allocation_count.h"
#include "tendril/daemon/black_box.h"
#include "tendril/daemon/control_cycle.h"
#include "tendril/rt/handoff.h"

namespace tendril::daemon {
namespace {

TEST(ControlCycleAllocation, NoneFromBootToMotion) {
  SimulatedClock clock;
  const RobotParameters robot = RigRobot();
  const DaemonParameters parameters = RigDaemon();
  EmulatedDrives drives(robot, parameters, clock);
  can::CanPort& port = drives.port();
  const std::vector<canopen::DriveSetup> setups = DriveSetups(robot, parameters.bus);
  canopen::Master master(parameters.bus, setups, port);
  control::Controller controller(robot, parameters.controller, parameters.bus.cycle_ns);
  ControlCycle cycle(controller, master, clock, parameters.bus,
                     [&](TimeNs deadline_ns) { return port.WaitUntil(deadline_ns); });
  BlackBox black_box({.seconds = 1, .folder = "/nowhere"}, parameters.lcm, ShapeOf(robot), {}, 0,
                     parameters.bus.cycle_ns, controller);
  rt::Handoff<CycleRecord> records(64);
  rt::Handoff<Command> commands(64);
  CycleRecord record, taken;
  std::uint64_t number = 0;
  const auto run = [&](int cycles, const Command& next, Mode until) {
    commands.TryPush(next);
    for (int i = 0; i < cycles; ++i) {
      clock.Advance(parameters.bus.cycle_ns);
      Command command;
      commands.TryPop(command);
      cycle.Run({.cycle = number++, .grid_ns = clock.Now(), .wake_latency_ns = 0, .missed = 0}, command, {},
                record);
      records.TryPush(record);
      black_box.Add(record, controller);
      records.TryPop(taken);
      if (i > 100 && record.output.mode == until) break;
    }
    return record.output.mode == until;
  };
  Command arm;
  arm.kind = CommandKind::kMode;
  arm.mode = ModeRequest::kArm;
  arm.sequence = 1;
  arm.valid_for_ns = 3600 * kNsPerS;
  Command bend;
  bend.kind = CommandKind::kBending;
  bend.sequence = 2;
  bend.valid_for_ns = 3600 * kNsPerS;
  bend.bending_rad = Eigen::Vector2d(0.4, -0.2);

  master.Start(clock.Now());
  const std::uint64_t before = test::AllocationCount();
  const bool configured = run(5000, {}, Mode::kConfigured);
  const bool running = run(5000, arm, Mode::kRunning);
  run(2000, bend, Mode::kFault);
  const std::uint64_t allocated = test::AllocationCount() - before;
  EXPECT_TRUE(configured);
  EXPECT_TRUE(running);
  EXPECT_NEAR(record.output.reference.position_rad[0], 0.4, 1e-9);
  EXPECT_GT(before, 0U) << "the counter counts";
  EXPECT_EQ(allocated, 0U);
}

}  // namespace
}  // namespace tendril::daemon
