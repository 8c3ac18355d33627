// Master against the drive emulator on a memory bus: the two halves, written apart, agree; and the load
// counted on the bus is what the budget says.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/test_rack.h"
#include "tendril/can/memory_bus.h"
#include "tendril/canopen/cia402.h"
#include "tendril/canopen/master.h"
#include "tendril/canopen/pdo.h"
#include "tendril/canopen/wire.h"

namespace tendril::canopen {
namespace {

class WithEmulator {
 public:
  explicit WithEmulator(int drives, TimeNs cycle_ns = kNsPerMs)
      : bus(clock),
        cycle_ns_(cycle_ns),
        rack(emulator::TestRack(drives), bus.AddPort()),
        master(TestBus(drives, cycle_ns), TestDrives(drives), bus.AddPort()),
        torques(static_cast<std::size_t>(drives)) {
    master.Start(clock.Now());
  }

  bool Step() {
    clock.Advance(cycle_ns_);
    master.BeginCycle(clock.Now());
    rack.Poll(clock.Now());
    const bool complete = master.Poll(clock.Now());
    master.EndCycle(clock.Now(), request, torques);
    BusEvent event;
    while (master.PopEvent(&event)) events.push_back(event);
    return complete;
  }
  bool StepUntil(DriveState state, int limit = 3000) {
    for (int i = 0; i < limit; ++i) {
      Step();
      bool all = true;
      for (int k = 0; k < master.drives(); ++k) all &= master.feedback(k).state == state;
      if (all) return true;
    }
    return false;
  }
  bool Enabled() {
    if (!StepUntil(DriveState::kReady)) return false;
    request = DriveRequest::kEnable;
    return StepUntil(DriveState::kEnabled, 200);
  }
  std::string Log() const {
    std::string log;
    for (const BusEvent& event : events) log += std::string(event.text.data()) + "\n";
    return log;
  }

  SimulatedClock clock{kNsPerS};
  can::MemoryBus bus;
  TimeNs cycle_ns_;
  emulator::DriveRack rack;
  Master master;
  DriveRequest request = DriveRequest::kDisable;
  std::vector<std::int16_t> torques;
  std::vector<BusEvent> events;
};

TEST(WithEmulator, BootsEnablesAndTurnsTorque) {
  WithEmulator rig(3);
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.torques = {100, -200, 300};
  rig.rack.SetSensors(
      1, {.position_counts = -12345, .velocity_rpm = 0, .actual_torque_Nm = 0, .analog_mV = {1234, 0}});
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(rig.Step());
  EXPECT_NEAR(rig.rack.torque_Nm(0), 0.1 * 7.056e-3, 1e-9);
  EXPECT_NEAR(rig.rack.torque_Nm(1), -0.2 * 7.056e-3, 1e-9);
  EXPECT_NEAR(rig.rack.torque_Nm(2), 0.3 * 7.056e-3, 1e-9);
  EXPECT_EQ(rig.master.feedback(1).position_counts, -12345);
  EXPECT_EQ(rig.master.feedback(1).analog_mV, 1234);
  rig.request = DriveRequest::kDisable;
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady, 50));
  EXPECT_EQ(rig.rack.torque_Nm(0), 0);
}

TEST(WithEmulator, LoadOnTheBusIsTheBudgetsCyclicShareAndNeverMoreThanTheWhole) {
  for (const auto& [drives, cycle_ns] : {std::pair{3, kNsPerMs}, std::pair{6, 2 * kNsPerMs}}) {
    WithEmulator rig(drives, cycle_ns);
    ASSERT_TRUE(rig.Enabled()) << rig.Log();
    for (int i = 0; i < 500; ++i) rig.Step();
    const std::uint64_t before = rig.bus.totals().bits;
    for (TimeNs t = 0; t < kNsPerS; t += cycle_ns) rig.Step();
    const auto counted = static_cast<double>(rig.bus.totals().bits - before);
    const BusBudget budget = ComputeBusBudget(TestBus(drives, cycle_ns), TestDrives(drives));
    // No SDO, for there is nothing to ask. Nothing happens to the statuswords here, so what is left beside
    // the cycle is heartbeats: 65 bits, 10 a second, from every drive and the master.
    EXPECT_DOUBLE_EQ(counted, budget.cyclic_bits_per_s + (drives + 1) * 650);
    EXPECT_LE(counted / 1e6, budget.load);
    EXPECT_LE(budget.load, 0.8);
  }
}

// The worst time for SDO: three drives at 1 kHz, all in the cycle, whose statuswords get lost, so that the
// master must ask for them, while a third of them restarts again and again.
TEST(WithEmulator, SdoNeverTakesMoreThanTheBudgetLeaves) {
  WithEmulator rig(3);
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady)) << rig.Log();
  int cycle_bits = 0, exchanges = 0;
  rig.bus.SetFilter([&](const can::CanFrame& frame) {
    cycle_bits += can::WorstCaseBits(frame);
    exchanges += CobFunction(frame.id) == kSdoRequestBase ? 1 : 0;
    return CobFunction(frame.id) != TpdoCobId(Epos4Profile()->pdos.status.number, 0);
  });
  rig.request = DriveRequest::kEnable;
  std::vector<int> bits;
  int all_exchanges = 0, last_exchange = -1000, shortest_gap = 1000;
  for (int i = 0; i < 3000; ++i) {
    const bool all = rig.master.feedback(0).state == DriveState::kReady &&
                     rig.master.feedback(1).state == DriveState::kReady &&
                     rig.master.feedback(2).state == DriveState::kReady;
    cycle_bits = exchanges = 0;
    if (i % 500 == 250) {
      rig.rack.PowerCycle(2);
      rig.master.ClearFaults(rig.clock.Now());
    }
    rig.Step();
    bits.push_back(cycle_bits);
    all_exchanges += exchanges;
    if (!all || exchanges == 0) continue;
    EXPECT_EQ(exchanges, 1) << "cycle " << i;
    shortest_gap = std::min(shortest_gap, i - last_exchange);
    last_exchange = i;
  }
  EXPECT_GT(all_exchanges, 300) << "the drive was booted anew several times";
  EXPECT_GE(shortest_gap, 9) << "29 bits of a cycle are left for 270 bits";
  // In any 20 cycles the bus carries no more than the budget allows, but for what was saved up before.
  constexpr int kWindow = 20, kSavedUp = 719;
  int sum = 0;
  for (std::size_t i = 0; i < bits.size(); ++i) {
    sum += bits[i] - (i >= kWindow ? bits[i - kWindow] : 0);
    EXPECT_LE(sum, kWindow * 800 + kSavedUp) << "cycle " << i;
  }
}

TEST(WithEmulator, SilentMasterIsAFaultOfTheDriveThatOneClearMends) {
  WithEmulator rig(2);
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.torques = {100, 100};
  rig.Step();
  // The daemon hangs for half a second.
  for (int i = 0; i < 500; ++i) {
    rig.clock.Advance(kNsPerMs);
    rig.rack.Poll(rig.clock.Now());
  }
  EXPECT_EQ(rig.rack.torque_Nm(0), 0) << "the drive let go by itself";
  EXPECT_FALSE(rig.rack.enabled(1));
  rig.Step();
  rig.Step();
  EXPECT_EQ(rig.master.feedback(0).error_code, 0x8130) << rig.Log();
  for (int i = 0; i < 200; ++i) rig.Step();
  EXPECT_FALSE(rig.rack.enabled(0)) << "nothing resumes by itself";

  rig.request = DriveRequest::kDisable;
  rig.master.ClearFaults(rig.clock.Now());
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady)) << rig.Log();
  EXPECT_FALSE(rig.rack.enabled(0));
  rig.request = DriveRequest::kEnable;
  EXPECT_TRUE(rig.StepUntil(DriveState::kEnabled, 200)) << rig.Log();
}

TEST(WithEmulator, OrderlyShutdownLeavesNoFaultBehind) {
  WithEmulator rig(2);
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  bool done = false;
  for (int i = 0; i < 2000 && !done; ++i) {
    rig.clock.Advance(kNsPerMs);
    done = rig.master.Shutdown(rig.clock.Now());
    rig.rack.Poll(rig.clock.Now());
  }
  EXPECT_TRUE(done);
  EXPECT_FALSE(rig.rack.enabled(0));
  for (int i = 0; i < 1000; ++i) {
    rig.clock.Advance(kNsPerMs);
    rig.rack.Poll(rig.clock.Now());
  }
  rig.request = DriveRequest::kDisable;
  rig.master.Start(rig.clock.Now());
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady)) << rig.Log();
}

TEST(WithEmulator, WrongMotorIsRefused) {
  SimulatedClock clock{kNsPerS};
  can::MemoryBus bus(clock);
  emulator::DriveRack rack(emulator::TestRack(1), bus.AddPort());
  auto setups = TestDrives(1);
  setups[0].rated_torque_uNm = 9000;
  Master master(TestBus(1, kNsPerMs), setups, bus.AddPort());
  master.Start(clock.Now());
  for (int i = 0; i < 1000; ++i) {
    clock.Advance(kNsPerMs);
    master.BeginCycle(clock.Now());
    rack.Poll(clock.Now());
    master.Poll(clock.Now());
    master.EndCycle(clock.Now(), DriveRequest::kEnable, {});
  }
  EXPECT_EQ(master.feedback(0).state, DriveState::kMisconfigured);
  BusEvent event;
  ASSERT_TRUE(master.PopEvent(&event));
  EXPECT_EQ(event.status, Status::kConfigurationMismatch);
  EXPECT_THAT(event.text.data(), ::testing::HasSubstr("rated torque: 6076:00 is 7056 uNm, expected 9000"));
}

}  // namespace
}  // namespace tendril::canopen
