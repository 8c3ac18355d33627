// The real master and the emulated drives on one memory bus, in simulated time: what each does is seen by the
// other. Knows both rooms' interfaces and neither's inside.
#include <gmock/gmock.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "support/test_rack.h"
#include "tendril/can/memory_bus.h"
#include "tendril/canopen/master.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {
namespace {

class ClosedLoop : public ::testing::Test {
 protected:
  ClosedLoop() : rack_(Parameters(), bus_.AddPort()), master_port_(bus_.AddPort()) {
    master_.emplace(Bus(), Setups(), master_port_);
  }

  static std::vector<EmulatedDriveParameters> Parameters() {
    std::vector<EmulatedDriveParameters> drives;
    for (int node = 1; node <= kDrives; ++node) {
      EmulatedDriveParameters p;
      p.node_id = node;
      drives.push_back(p);  // no motor data: the master must bring them
    }
    return drives;
  }
  static std::vector<canopen::DriveSetup> Setups() {
    std::vector<canopen::DriveSetup> drives;
    for (int node = 1; node <= kDrives; ++node) drives.push_back({node, 360, 360, 19600, 7056});
    return drives;
  }
  static BusParameters Bus() {
    BusParameters bus;
    bus.interface = "memory";
    bus.bitrate_bps = 1'000'000;
    bus.cycle_ns = kNsPerMs;
    bus.feedback_deadline_ns = 700'000;
    bus.heartbeat_ms = 100;
    bus.heartbeat_timeout_ms = 350;
    bus.sdo_timeout_ms = 200;
    bus.boot_timeout_ms = 3000;
    bus.abort_connection_option = 2;
    bus.identity = {0xFB, {0x60500000}, 0x01600000, 0x01800000};
    for (int node = 1; node <= kDrives; ++node) bus.nodes.push_back({node, node});
    return bus;
  }

  /// One cycle of 1 ms; true when every drive's feedback came.
  bool Cycle(DriveRequest request = DriveRequest::kDisable, std::int16_t torque = 0) {
    clock_.Advance(kNsPerMs);
    master_->BeginCycle(clock_.Now());
    rack_.Poll(clock_.Now());
    const bool all = master_->Poll(clock_.Now());
    const std::array<std::int16_t, kDrives> torques = {torque, static_cast<std::int16_t>(2 * torque),
                                                       static_cast<std::int16_t>(-torque)};
    master_->EndCycle(clock_.Now(), request, torques);
    canopen::BusEvent event;
    while (master_->PopEvent(&event)) events_ += std::string(event.text.data()) + "\n";
    return all;
  }

  template <typename Predicate>
  int CyclesUntil(Predicate done, DriveRequest request = DriveRequest::kDisable, int most = 5000) {
    for (int i = 0; i < most; ++i) {
      if (done()) return i;
      Cycle(request);
    }
    ADD_FAILURE() << "did not happen within " << most << " cycles; events:\n" << events_;
    return most;
  }

  bool All(DriveState state) const {
    for (int i = 0; i < kDrives; ++i) {
      if (master_->feedback(i).state != state) return false;
    }
    return true;
  }
  void BootAndEnable() {
    master_->Start(clock_.Now());
    CyclesUntil([&] { return All(DriveState::kReady); });
    CyclesUntil([&] { return All(DriveState::kEnabled); }, DriveRequest::kEnable);
  }

  SimulatedClock clock_;
  can::MemoryBus bus_{clock_};
  DriveRack rack_;
  can::CanPort& master_port_;
  std::optional<canopen::Master> master_;
  std::string events_;
};

TEST_F(ClosedLoop, BootsEveryDriveAndEnablesIt) {
  master_->Start(clock_.Now());
  const int boot = CyclesUntil([&] { return All(DriveState::kReady); });
  EXPECT_LT(boot, 500) << "ms to configure three drives";
  for (int i = 0; i < kDrives; ++i) EXPECT_FALSE(rack_.enabled(i)) << "booting must not power a motor";
  const int enable = CyclesUntil([&] { return All(DriveState::kEnabled); }, DriveRequest::kEnable);
  EXPECT_LT(enable, 100);
  for (int i = 0; i < kDrives; ++i) EXPECT_TRUE(rack_.enabled(i));
  RecordProperty("boot_ms", boot);
  RecordProperty("enable_ms", enable);
}

TEST_F(ClosedLoop, TorqueSentInOneCycleActsAtTheNextSync) {
  BootAndEnable();
  Cycle(DriveRequest::kEnable, 0);
  Cycle(DriveRequest::kEnable, 0);
  ASSERT_TRUE(Cycle(DriveRequest::kEnable, 100));
  rack_.Poll(clock_.Now());
  EXPECT_EQ(rack_.torque_Nm(0), 0.0) << "sent, but no SYNC yet";
  ASSERT_TRUE(Cycle(DriveRequest::kEnable, -300));
  EXPECT_NEAR(rack_.torque_Nm(0), 0.1 * kRated_Nm, 1e-12);
  EXPECT_NEAR(rack_.torque_Nm(1), 0.2 * kRated_Nm, 1e-12);
  EXPECT_NEAR(rack_.torque_Nm(2), -0.1 * kRated_Nm, 1e-12);
  Cycle(DriveRequest::kEnable, 0);
  EXPECT_NEAR(rack_.torque_Nm(0), -0.3 * kRated_Nm, 1e-12);
}

TEST_F(ClosedLoop, FeedbackIsThatOfItsSyncAndEveryCycleComplete) {
  BootAndEnable();
  for (int i = 0; i < 1000; ++i) {
    for (int d = 0; d < kDrives; ++d) {
      rack_.SetSensors(d, {.position_counts = 1000 * i + d,
                           .velocity_rpm = 0,
                           .actual_torque_Nm = 1e-3 * i * kRated_Nm * (d == 1 ? -1 : 1),
                           .analog_mV = {static_cast<std::int16_t>(i - 500), 0}});
    }
    ASSERT_TRUE(Cycle(DriveRequest::kEnable, 0)) << i;
    for (int d = 0; d < kDrives; ++d) {
      const DriveFeedback& f = master_->feedback(d);
      ASSERT_EQ(f.age_cycles, 0);
      ASSERT_EQ(f.position_counts, 1000 * i + d);
      ASSERT_EQ(f.torque_permille, d == 1 ? -i : i);
      ASSERT_EQ(f.analog_mV, i - 500);
    }
  }
}

// The bus carries no more than the budget says: 78 % for three drives at 1 kHz, heartbeats and SDO included.
TEST_F(ClosedLoop, LoadStaysWithinTheComputedBudget) {
  BootAndEnable();
  const std::uint64_t before = bus_.totals().bits;
  for (int i = 0; i < 2000; ++i) Cycle(DriveRequest::kEnable, static_cast<std::int16_t>(i % 100));
  const double load = static_cast<double>(bus_.totals().bits - before) / 2e6;
  EXPECT_LE(load, canopen::ComputeBusBudget(Bus(), Setups()).load);
  EXPECT_GE(load, 0.745) << "3 x 230 + 55 bits each millisecond";
}

TEST_F(ClosedLoop, AnErrorOfADriveIsReportedAndOnlyTheOperatorClearsIt) {
  BootAndEnable();
  rack_.InjectEmcy(1, 0x2310);
  CyclesUntil([&] { return master_->feedback(1).state == DriveState::kFault; }, DriveRequest::kEnable, 10);
  EXPECT_EQ(master_->feedback(1).error_code, 0x2310);
  EXPECT_THAT(events_, ::testing::HasSubstr("over-current"));
  for (int i = 0; i < 500; ++i) Cycle(DriveRequest::kEnable, 100);
  EXPECT_FALSE(rack_.enabled(1)) << "nothing resumes by itself";
  master_->ClearFaults(clock_.Now());
  CyclesUntil([&] { return master_->feedback(1).state == DriveState::kReady; });
  CyclesUntil([&] { return All(DriveState::kEnabled); }, DriveRequest::kEnable);
  EXPECT_TRUE(rack_.enabled(1));
}

TEST_F(ClosedLoop, APowerCycledDriveComesBackOnlyAfterClear) {
  BootAndEnable();
  rack_.PowerCycle(0);
  CyclesUntil([&] { return master_->feedback(0).state != DriveState::kEnabled; }, DriveRequest::kEnable, 10);
  for (int i = 0; i < 500; ++i) Cycle(DriveRequest::kEnable, 100);
  EXPECT_FALSE(rack_.enabled(0));
  master_->ClearFaults(clock_.Now());
  CyclesUntil([&] { return All(DriveState::kReady); });
  CyclesUntil([&] { return All(DriveState::kEnabled); }, DriveRequest::kEnable);
}

TEST_F(ClosedLoop, AFrozenDriveAgesAndIsLost) {
  BootAndEnable();
  rack_.SetFrozen(2, true);
  for (int age = 1; age <= 20; ++age) {
    EXPECT_FALSE(Cycle(DriveRequest::kEnable, 0));
    EXPECT_EQ(master_->feedback(2).age_cycles, age);
  }
  EXPECT_EQ(master_->feedback(0).age_cycles, 0);
  CyclesUntil([&] { return master_->feedback(2).state == DriveState::kOffline; }, DriveRequest::kEnable, 500);
}

TEST_F(ClosedLoop, AStoppedHeartbeatIsNoticedThoughTheFeedbackComes) {
  BootAndEnable();
  rack_.StopHeartbeat(0);
  const int cycles = CyclesUntil([&] { return master_->feedback(0).state != DriveState::kEnabled; },
                                 DriveRequest::kEnable, 1000);
  EXPECT_LE(cycles, 351 + 1);
}

TEST_F(ClosedLoop, WithoutTheMasterEveryDriveLetsGo) {
  BootAndEnable();
  for (int i = 0; i < 10; ++i) Cycle(DriveRequest::kEnable, 300);
  EXPECT_NE(rack_.torque_Nm(0), 0.0);
  int silent_ms = 0;
  while (rack_.enabled(0) && silent_ms < 1000) {  // the daemon is gone
    clock_.Advance(kNsPerMs);
    rack_.Poll(clock_.Now());
    ++silent_ms;
  }
  EXPECT_LE(silent_ms, 350);
  for (int i = 0; i < kDrives; ++i) EXPECT_EQ(rack_.torque_Nm(i), 0.0);

  // A new daemon finds the drives in fault, and recovers them when it is told to.
  master_.emplace(Bus(), Setups(), master_port_);
  master_->Start(clock_.Now());
  for (int i = 0; i < 1000; ++i) Cycle();
  if (!All(DriveState::kReady)) {
    master_->ClearFaults(clock_.Now());
    CyclesUntil([&] { return All(DriveState::kReady); });
  }
  CyclesUntil([&] { return All(DriveState::kEnabled); }, DriveRequest::kEnable);
}

TEST_F(ClosedLoop, BusOffDisablesEverythingAndRecoversWhenCleared) {
  BootAndEnable();
  bus_.SetBusOff(true);
  for (int i = 0; i < 500; ++i) Cycle(DriveRequest::kEnable, 100);
  EXPECT_FALSE(master_->bus_ok());
  for (int i = 0; i < kDrives; ++i) EXPECT_FALSE(rack_.enabled(i)) << "heartbeat lost";
  bus_.SetBusOff(false);
  for (int i = 0; i < 500; ++i) Cycle(DriveRequest::kEnable, 100);
  for (int i = 0; i < kDrives; ++i) EXPECT_FALSE(rack_.enabled(i)) << "nothing resumes by itself";
  master_->ClearFaults(clock_.Now());
  CyclesUntil([&] { return All(DriveState::kReady); });
  CyclesUntil([&] { return All(DriveState::kEnabled); }, DriveRequest::kEnable);
}

TEST_F(ClosedLoop, ShutdownLeavesTheDrivesOffAndWithoutFault) {
  BootAndEnable();
  for (int i = 0; i < 2000 && !master_->Shutdown(clock_.Now()); ++i) {
    clock_.Advance(kNsPerMs);
    rack_.Poll(clock_.Now());
  }
  rack_.Poll(clock_.Now());
  EXPECT_TRUE(master_->Shutdown(clock_.Now()));
  for (int i = 0; i < kDrives; ++i) EXPECT_FALSE(rack_.enabled(i));
  bool emcy = false;
  bus_.SetFilter([&](can::CanFrame& f) {
    emcy |= f.id > 0x80 && f.id < 0x100;
    return true;
  });
  for (int i = 0; i < 1000; ++i) {
    clock_.Advance(kNsPerMs);
    rack_.Poll(clock_.Now());
  }
  EXPECT_FALSE(emcy) << "the silence after an orderly end is no error";
}

// Any frame of the configuration may be lost: the boot ends all the same.
TEST_F(ClosedLoop, BootSurvivesLostFrames) {
  unsigned n = 0;
  bus_.SetFilter([&](can::CanFrame&) { return ++n % 23 != 0; });
  master_->Start(clock_.Now());
  for (int i = 0; i < 8000 && !All(DriveState::kReady); ++i) Cycle();
  EXPECT_TRUE(All(DriveState::kReady)) << events_;
}

}  // namespace
}  // namespace tendril::emulator
