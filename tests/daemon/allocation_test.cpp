// The whole cycle (master, controller, record, hand-off, black box) allocates nothing, locks nothing and
// writes nowhere, from boot to motion; nor do the bus in memory and the drives emulated on it, which run on
// the same thread here. The same of the daemon's own loop, and of every feedback on the way from slack to a
// safe stop.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "emulated_drives.h"
#include "safety_rig.h"
#include "support/allocation_count.h"
#include "support/outside_count.h"
#include "tendril/daemon/black_box.h"
#include "tendril/daemon/control_cycle.h"
#include "tendril/daemon/daemon.h"
#include "tendril/experiment/log_replay.h"
#include "tendril/io/client.h"
#include "tendril/rt/handoff.h"
#include "tendril_lcm/state_t.hpp"

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
  ControlCycle cycle(controller, master, clock, robot, parameters.bus,
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
  const std::uint64_t before = test::AllocationCount(), outside_before = test::OutsideCount();
  const bool configured = run(5000, {}, Mode::kConfigured);
  const bool running = run(5000, arm, Mode::kRunning);
  run(2000, bend, Mode::kFault);
  const std::uint64_t allocated = test::AllocationCount() - before;
  const std::uint64_t outside = test::OutsideCount() - outside_before;
  EXPECT_TRUE(configured);
  EXPECT_TRUE(running);
  EXPECT_NEAR(record.output.reference.position_rad[0], 0.4, 1e-9);
  EXPECT_GT(before, 0U) << "the counter counts";
  EXPECT_EQ(allocated, 0U);
  EXPECT_EQ(outside, 0U);
}

// What the counters count, and of which thread.
TEST(Counters, SeeAllocationsLocksAndLogLines) {
  const std::uint64_t allocated = test::AllocationCount(), outside = test::OutsideCount();
  std::thread other([] {
    std::mutex mutex;
    const std::lock_guard lock(mutex);
    std::vector<int> v(1000, 1);
  });
  const std::uint64_t after_thread = test::OutsideCount();
  other.join();
  std::mutex mutex;
  mutex.lock();
  mutex.unlock();
  EXPECT_EQ(test::OutsideCount(), after_thread + 1);
  spdlog::warn("a line of log");
  EXPECT_GT(test::OutsideCount(), after_thread + 2);
  EXPECT_GT(test::AllocationCount(), allocated);
  EXPECT_GE(after_thread, outside);
}

// The daemon's own loop, from cycle to cycle: commands, a refusal, motion, a fault with its black box,
// clearing.
TEST(DaemonLoop, NeitherAllocatesNorLocksNorWrites) {
  const MonotonicClock clock;
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("tendril_loop_" + std::to_string(getpid()));
  DaemonOptions options{RigDaemon(), RigRobot(), ""};
  // The machine may be busy with other tests.
  options.parameters.bus.heartbeat_timeout_ms = 5000;
  options.parameters.bus.sdo_timeout_ms = 2000;
  options.parameters.bus.boot_timeout_ms = 20000;
  options.parameters.controller.guards.max_late_cycles = 5000;
  options.parameters.controller.guards.max_missing_cycles = 50;
  options.parameters.controller.pretension_ramp_Nps = 20;
  options.parameters.black_box = {.seconds = 1, .folder = folder};
  EmulatedDrives drives(options.robot, options.parameters, clock);
  // Seen from within the loop: at each SYNC.
  std::atomic<std::uint64_t> cycles{0}, allocated{0}, outside{0};
  std::atomic<bool> silent{false};
  std::uint64_t allocated_before = 0, outside_before = 0;
  drives.bus().SetFilter([&](can::CanFrame& f) {
    if (f.id == 0x080) {
      if (cycles++ == 0) {
        allocated_before = test::AllocationCount();
        outside_before = test::OutsideCount();
      }
      allocated = test::AllocationCount() - allocated_before;
      outside = test::OutsideCount() - outside_before;
    }
    return !(silent && f.id == 0x182);
  });
  Daemon daemon(options, drives.port());
  io::Client client(daemon.gateway().lcm(), "TENDRIL");
  int mode = -1;
  std::uint32_t sequence = 0;
  client.OnState([&](const tendril_lcm::state_t& s) { mode = s.mode; });
  const auto send = [&](Command c) {
    c.sequence = ++sequence;
    c.valid_for_ns = 10 * kNsPerS;
    client.Send(c, 0);
  };
  const auto request = [&](ModeRequest r) {
    Command c;
    c.kind = CommandKind::kMode;
    c.mode = r;
    send(c);
  };
  Command bend;
  bend.kind = CommandKind::kBending;
  bend.bending_rad = Eigen::Vector2d(0.4, -0.2);
  // One step after the other, each once its mode is there.
  using tendril_lcm::state_t;
  const std::vector<std::pair<int, std::function<void()>>> plan{
      {state_t::MODE_CONFIGURED, [&] { send(bend); }},  // refused
      {state_t::MODE_CONFIGURED, [&] { request(ModeRequest::kArm); }},
      {state_t::MODE_RUNNING, [&] { send(bend); }},
      {state_t::MODE_RUNNING, [&] { silent = true; }},
      {state_t::MODE_FAULT, [&] { silent = false; }},
      {state_t::MODE_FAULT, [&] { request(ModeRequest::kClear); }},
      {state_t::MODE_CONFIGURED, [&] { request(ModeRequest::kHome); }},
      {state_t::MODE_FAULT, [] {}}};  // motors that nothing turns are jammed
  std::size_t step = 0;
  TimeNs next_ns = 0;
  const TimeNs end_ns = clock.Now() + 30 * kNsPerS;
  daemon.Run([&] {
    if (step < plan.size() && mode == plan[step].first && clock.Now() >= next_ns) {
      plan[step++].second();
      next_ns = clock.Now() + 100 * kNsPerMs;
    }
    return step == plan.size() || clock.Now() > end_ns;
  });
  EXPECT_EQ(step, plan.size());
  EXPECT_GT(cycles, 500U);
  EXPECT_EQ(allocated, 0U);
  EXPECT_EQ(outside, 0U);
  EXPECT_FALSE(std::filesystem::is_empty(folder)) << "a black box was written, by the other thread";
  std::filesystem::remove_all(folder);
}

// Homing, the equilibrium law with load cells and tracker, tensions, a safe stop: on the plant, and then
// again from what was recorded.
TEST(Replay, OfEveryFeedbackGivesTheSameBitsWithoutAllocationLockOrWrite) {
  SafetyOptions o;
  o.daemon = RigDaemon();
  o.daemon.controller.guards.max_torque_error_N = 1;
  o.daemon.controller.law = ControlLaw::kEquilibrium;
  o.daemon.controller.tension_feedback = o.daemon.controller.tip_feedback = true;
  o.robot = o.plant = RigRobot();
  o.plant.effects.push_back({.name = "slack", .where = "tendon:1", .values = {{"m", 0.002}}});
  SafetyRig rig(o);
  std::vector<CycleRecord> records;
  const auto step = [&](const Command& c = {}) { records.push_back(rig.Step(c)); };
  const auto until = [&](Mode mode, int most) {
    for (int i = 0; i < most && rig.output().mode != mode; ++i) step();
    return rig.output().mode == mode;
  };
  ASSERT_TRUE(until(Mode::kConfigured, 5000));
  step(rig.Request(ModeRequest::kHome));
  ASSERT_TRUE(until(Mode::kHold, 10'000));
  step(rig.Request(ModeRequest::kArm));
  for (int i = 0; i < 1500; ++i) step(i % 10 == 0 ? rig.Circle(0.5, 2, i * 1e-3) : Command{});
  for (int i = 0; i < 500; ++i) step(i % 10 == 0 ? rig.Tensions(Eigen::Vector3d(2, 0.5, 0.5)) : Command{});
  ASSERT_EQ(rig.output().mode, Mode::kRunning) << StatusText(rig.output().status);
  step(rig.Request(ModeRequest::kDisarm));
  ASSERT_TRUE(until(Mode::kConfigured, 5000));

  control::Controller again(o.robot, o.daemon.controller, o.daemon.bus.cycle_ns);
  CycleOutput output;
  std::uint64_t allocated = 0, outside = 0;
  for (const CycleRecord& r : records) {
    const std::uint64_t allocated_before = test::AllocationCount(), outside_before = test::OutsideCount();
    again.Step(r.input, output);
    allocated += test::AllocationCount() - allocated_before;
    outside += test::OutsideCount() - outside_before;
    const auto difference = experiment::FirstDifference(r.output, output);
    ASSERT_FALSE(difference) << difference->field << " in cycle " << r.input.cycle;
  }
  EXPECT_EQ(allocated, 0U);
  EXPECT_EQ(outside, 0U);
}

}  // namespace
}  // namespace tendril::daemon
