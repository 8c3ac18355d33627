// One cycle at a time, in simulated time: it ends whatever the bus does, and what it records is enough to run
// it again.
#include "tendril/daemon/control_cycle.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <vector>

#include "emulated_drives.h"
#include "tendril/io/log.h"
#include "tendril/io/wire.h"

namespace tendril::daemon {
namespace {

class Loop {
 public:
  Loop() {
    master.Start(clock.Now());
    wait = [this](TimeNs deadline_ns) { return drives.port().WaitUntil(deadline_ns); };
  }

  const CycleRecord& Step(const Command& command = {}, std::uint64_t missed = 0) {
    clock.Advance(parameters.bus.cycle_ns * static_cast<TimeNs>(1 + missed));
    cycle.Run({.cycle = count++, .grid_ns = clock.Now(), .wake_latency_ns = 0, .missed = missed}, command, {},
              record);
    return record;
  }

  Command Mode(ModeRequest request) {
    Command c;
    c.kind = CommandKind::kMode;
    c.mode = request;
    c.sequence = ++sequence;
    c.received_ns = clock.Now();
    c.valid_for_ns = kNsPerS;
    return c;
  }

  bool StepUntil(tendril::Mode mode, int most = 5000) {
    for (int i = 0; i < most; ++i) {
      if (Step().output.mode == mode) return true;
    }
    return false;
  }

  SimulatedClock clock;
  RobotParameters robot = RigRobot();
  DaemonParameters parameters = RigDaemon();
  EmulatedDrives drives{robot, parameters, clock};
  std::vector<canopen::DriveSetup> setups = DriveSetups(robot, parameters.bus);
  canopen::Master master{parameters.bus, setups, drives.port()};
  control::Controller controller{robot, parameters.controller, parameters.bus.cycle_ns};
  ControlCycle::Wait wait;
  ControlCycle cycle{controller, master, clock, robot, parameters.bus, [this](TimeNs t) { return wait(t); }};
  CycleRecord record;
  std::uint64_t count = 0;
  std::uint32_t sequence = 0;
};

TEST(ControlCycle, DrivesAreConfiguredAndEnabledOnlyWhenAsked) {
  Loop loop;
  ASSERT_TRUE(loop.StepUntil(Mode::kConfigured));
  for (int i = 0; i < 100; ++i) loop.Step();
  for (int d = 0; d < 3; ++d) EXPECT_FALSE(loop.drives.rack().enabled(d));
  loop.Step(loop.Mode(ModeRequest::kArm));
  ASSERT_TRUE(loop.StepUntil(Mode::kRunning));
  for (int d = 0; d < 3; ++d) {
    EXPECT_TRUE(loop.drives.rack().enabled(d));
    EXPECT_GT(loop.drives.rack().torque_Nm(d), 0) << "pretension pulls";
  }
}

TEST(ControlCycle, TheTorqueRecordedIsWhatTheDriveGetsAtTheNextSync) {
  Loop loop;
  ASSERT_TRUE(loop.StepUntil(Mode::kConfigured));
  loop.Step(loop.Mode(ModeRequest::kArm));
  ASSERT_TRUE(loop.StepUntil(Mode::kPretension));
  for (int i = 0; i < 50; ++i) {
    const auto sent = loop.record.output.torque_target_permille;
    loop.Step();
    for (int d = 0; d < 3; ++d) {
      EXPECT_NEAR(loop.drives.rack().torque_Nm(d), 7056e-6 * sent[static_cast<std::size_t>(d)] / 1000, 1e-12);
    }
  }
}

TEST(ControlCycle, ASilentDriveMakesFeedbackOldNotTheCycleLong) {
  Loop loop;
  ASSERT_TRUE(loop.StepUntil(Mode::kConfigured));
  loop.drives.bus().SetFilter([](can::CanFrame& f) { return f.id != 0x182; });
  const CycleRecord& r = loop.Step();
  EXPECT_EQ(r.input.drive[0].age_cycles, 0);
  EXPECT_EQ(r.input.drive[1].age_cycles, 1);
  EXPECT_EQ(r.input.drive[2].age_cycles, 0);
}

// An adapter that is pulled is no bus-off, and its operator is to look for other things: from the cycle on in
// which it is seen, through the latched fault, to the log and its replay.
TEST(ControlCycle, AnInterfaceThatIsGoneIsToldFromBusOff) {
  for (const bool down : {true, false}) {
    SCOPED_TRACE(down);
    Loop loop;
    ASSERT_TRUE(loop.StepUntil(Mode::kConfigured));
    loop.Step(loop.Mode(ModeRequest::kArm));
    ASSERT_TRUE(loop.StepUntil(Mode::kRunning));
    if (down) {
      loop.drives.TakeDown(true);
    } else {
      loop.drives.bus().SetBusOff(true);
    }
    const Status expected = down ? Status::kInterfaceDown : Status::kBusOff;
    ASSERT_TRUE(loop.StepUntil(Mode::kFault, 5));
    EXPECT_EQ(loop.record.output.status, expected) << StatusText(loop.record.output.status);
    for (int i = 0; i < 100; ++i) loop.Step();
    EXPECT_EQ(loop.record.output.status, expected) << "latched";
    EXPECT_EQ(loop.record.input.drive[0].state, down ? DriveState::kUnreachable : DriveState::kOffline);
    canopen::BusEvent event;
    std::string told;
    while (loop.master.PopEvent(&event)) {
      if (event.status == expected) told = event.text.data();
    }
    EXPECT_NE(told.find(down ? "went down" : "bus-off"), std::string::npos) << told;

    tendril_lcm::cycle_t message{};
    io::ToMessage(loop.record, ShapeOf(loop.robot), 0, message);
    CycleRecord back;
    ASSERT_TRUE(io::FromMessage(message, back));
    EXPECT_EQ(back.input.drive[0].state, loop.record.input.drive[0].state);
    EXPECT_FALSE(back.input.bus_ok);

    if (!down) continue;
    loop.drives.TakeDown(false);
    for (int i = 0; i < 3000; ++i) loop.Step();
    EXPECT_EQ(loop.record.output.mode, Mode::kFault) << "nothing goes on by itself";
    loop.Step(loop.Mode(ModeRequest::kClear));
    ASSERT_TRUE(loop.StepUntil(Mode::kConfigured)) << StatusText(loop.record.output.status);
    // Drives that were gone may have let their tendons go.
    loop.Step(loop.Mode(ModeRequest::kArm));
    ASSERT_TRUE(loop.StepUntil(Mode::kFault));
    EXPECT_EQ(loop.record.output.status, Status::kTendonSlack);
    loop.drives.ShowTension(loop.robot);
    for (int i = 0; i < 100; ++i) loop.Step();
    loop.Step(loop.Mode(ModeRequest::kClear));
    ASSERT_TRUE(loop.StepUntil(Mode::kConfigured)) << StatusText(loop.record.output.status);
    loop.Step(loop.Mode(ModeRequest::kArm));
    EXPECT_TRUE(loop.StepUntil(Mode::kRunning)) << StatusText(loop.record.output.status);
  }
}

// A bus on which something is always waiting but never the feedback, with a clock that stands still.
TEST(ControlCycle, ABabblingBusCannotKeepItFromEnding) {
  Loop loop;
  ASSERT_TRUE(loop.StepUntil(Mode::kConfigured));
  loop.drives.bus().SetFilter([](can::CanFrame& f) { return f.id != 0x182; });
  int waits = 0;
  loop.wait = [&](TimeNs) {
    ++waits;
    return true;
  };
  loop.Step();
  EXPECT_GT(waits, 10);
  EXPECT_LE(waits, 10'000);
}

TEST(ControlCycle, MissedPeriodsAreCountedAndSeenByTheController) {
  Loop loop;
  loop.Step();
  EXPECT_FALSE(loop.record.input.late);
  loop.Step({}, 3);
  EXPECT_TRUE(loop.record.input.late);
  EXPECT_EQ(loop.record.timing.deadline_misses, 3U);
  loop.Step();
  EXPECT_FALSE(loop.record.input.late);
  EXPECT_EQ(loop.record.timing.deadline_misses, 3U);
}

// The point of recording: a controller fed from the log alone does the same, bit for bit, over a boot,
// arming, motion, a refused command, a lost drive and its fault.
TEST(ControlCycle, ALogReplaysBitForBit) {
  namespace fs = std::filesystem;
  const fs::path path =
      fs::temp_directory_path() / ("tendril_replay_" + std::to_string(getpid()) + ".lcmlog");
  Loop loop;
  const io::RobotShape shape = ShapeOf(loop.robot);
  {
    io::Gateway gateway(loop.parameters.lcm, shape, loop.clock);
    io::LogWriter log(gateway, path, loop.clock);
    const auto step = [&](const Command& c = {}) {
      gateway.PublishCycle(loop.Step(c));
      gateway.Handle(0);
    };
    for (int i = 0; i < 2000 && loop.record.output.mode != Mode::kConfigured; ++i) step();
    step(loop.Mode(ModeRequest::kArm));
    for (int i = 0; i < 2000 && loop.record.output.mode != Mode::kRunning; ++i) step();
    ASSERT_EQ(loop.record.output.mode, Mode::kRunning);
    Command tip = loop.Mode(ModeRequest::kHold);
    tip.kind = CommandKind::kTip;
    tip.tip_W_m = {0.02, 0.01, 0.055};
    step(tip);
    for (int i = 0; i < 500; ++i) step();
    Command bad = loop.Mode(ModeRequest::kHold);
    bad.kind = CommandKind::kBending;
    bad.bending_rad = BendingVector::Constant(5, std::numeric_limits<double>::quiet_NaN());
    step(bad);
    EXPECT_NE(loop.record.output.command_status, Status::kOk);
    loop.drives.bus().SetFilter([](can::CanFrame& f) { return f.id != 0x182; });
    for (int i = 0; i < 500; ++i) step();
    EXPECT_EQ(loop.record.output.mode, Mode::kFault);
  }
  const io::LogContents log = io::ReadLog(path);
  fs::remove(path);
  ASSERT_EQ(log.damage, "");
  ASSERT_EQ(log.cycles.size(), loop.count);

  control::Controller again(loop.robot, loop.parameters.controller, loop.parameters.bus.cycle_ns);
  tendril_lcm::cycle_t recorded{}, replayed{};
  std::vector<std::uint8_t> a, b;
  const auto encode = [](const tendril_lcm::cycle_t& m, std::vector<std::uint8_t>& bytes) {
    bytes.assign(static_cast<std::size_t>(m.getEncodedSize()), 0);
    m.encode(bytes.data(), 0, m.getEncodedSize());
  };
  for (const CycleRecord& cycle : log.cycles) {
    CycleRecord replay = cycle;
    replay.output = {};
    again.Step(cycle.input, replay.output);
    io::ToMessage(cycle, shape, 0, recorded);
    io::ToMessage(replay, shape, 0, replayed);
    encode(recorded, a);
    encode(replayed, b);
    ASSERT_EQ(a, b) << "cycle " << cycle.input.cycle;
  }
}

}  // namespace
}  // namespace tendril::daemon
