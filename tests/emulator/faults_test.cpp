// Every kind of fault on demand against the real master on a memory bus: what the master then says and does.
// Knows both sides from outside only.
#include "tendril/emulator/faults.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "support/test_rack.h"
#include "tendril/can/memory_bus.h"
#include "tendril/canopen/master.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {
namespace {

using canopen::BusEvent;
using canopen::Master;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::HasSubstr;

class Rig {
 public:
  explicit Rig(std::uint64_t seed = 1)
      : bus(clock),
        faults(bus.AddPort(), seed),
        rack(TestRack(kDrives), faults),
        master(canopen::TestBus(kDrives), canopen::TestDrives(kDrives), bus.AddPort()) {
    faults.Attach(rack);
    master.Start(clock.Now());
  }

  void Order(const FaultParameters& fault) { faults.Add(fault, clock.Now()); }

  /// One cycle; true when every drive's feedback came in time.
  bool Step() {
    clock.Advance(kNsPerMs);
    master.BeginCycle(clock.Now());
    faults.Poll(clock.Now());
    rack.Poll(clock.Now());
    const bool complete = master.Poll(clock.Now());
    master.EndCycle(clock.Now(), request, torques);
    BusEvent event;
    while (master.PopEvent(&event)) events.push_back(event);
    return complete;
  }
  void Run(int cycles) {
    for (int i = 0; i < cycles; ++i) Step();
  }
  bool RunUntil(DriveState state, int limit = 3500) {
    for (int i = 0; i < limit; ++i) {
      Step();
      bool all = true;
      for (int k = 0; k < kDrives; ++k) all &= master.feedback(k).state == state;
      if (all) return true;
    }
    return false;
  }
  bool Enabled() {
    if (!RunUntil(DriveState::kReady)) return false;
    request = DriveRequest::kEnable;
    if (!RunUntil(DriveState::kEnabled, 200)) return false;
    Run(100);  // heartbeats and statuswords of the start have settled
    events.clear();
    return true;
  }
  /// As the operator after a fault: clear, then arm again.
  bool Recovers() {
    request = DriveRequest::kDisable;
    master.ClearFaults(clock.Now());
    if (!RunUntil(DriveState::kReady)) return false;
    request = DriveRequest::kEnable;
    return RunUntil(DriveState::kEnabled, 300);
  }
  std::string Log() const {
    std::string log;
    for (const BusEvent& event : events) log += std::string(event.text.data()) + "\n";
    return log;
  }
  /// Status codes of the events of a node, without the informing ones.
  std::set<Status> Told(int node) const {
    std::set<Status> told;
    for (const BusEvent& event : events) {
      if (event.node_id == node && event.status != Status::kOk) told.insert(event.status);
    }
    return told;
  }
  /// Of each node's COB-ID frames and of those to all.
  std::string Course() const {
    std::string course;
    for (const BusEvent& event : events) {
      course += std::to_string(event.time_ns) + " " + event.text.data() + "\n";
    }
    for (int i = 0; i < kDrives; ++i) course += std::to_string(master.feedback(i).age_cycles) + " ";
    return course + std::to_string(bus.totals().sent);
  }

  SimulatedClock clock{kNsPerS};
  can::MemoryBus bus;
  FaultInjector faults;
  DriveRack rack;
  Master master;
  DriveRequest request = DriveRequest::kDisable;
  std::vector<std::int16_t> torques = std::vector<std::int16_t>(kDrives, 100);
  std::vector<BusEvent> events;
};

using Codes = std::set<Status>;

// ---- without faults
// --------------------------------------------------------------------------------------------

TEST(Faults, WithoutOrdersThePortIsTransparent) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  for (int i = 0; i < 500; ++i) ASSERT_TRUE(rig.Step());
  EXPECT_TRUE(rig.events.empty()) << rig.Log();
  EXPECT_NEAR(rig.rack.torque_Nm(1), 0.1 * kRated_Nm, 1e-9);
  EXPECT_EQ(rig.faults.faults().dropped + rig.faults.faults().delayed, 0u);
}

TEST(Faults, NodesThatAreNotThereAreRefusedByName) {
  Rig rig;
  try {
    rig.Order({.kind = FaultKind::kDie, .node = 9});
    FAIL() << "accepted";
  } catch (const std::invalid_argument& e) {
    EXPECT_STREQ(e.what(), "node 9 is none of the emulated drives; accepted: 1 2 3; correct the node");
  }
}

// ---- frames
// ----------------------------------------------------------------------------------------------------

TEST(Faults, DroppedFeedbackAgesForAsManyCyclesAsWereDropped) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order(
      {.kind = FaultKind::kDrop, .direction = FrameDirection::kFromDrives, .cob_id = 0x182, .count = 3});
  for (int missing = 1; missing <= 3; ++missing) {
    EXPECT_FALSE(rig.Step());
    EXPECT_EQ(rig.master.feedback(1).age_cycles, missing);
    EXPECT_EQ(rig.master.feedback(0).age_cycles, 0);
  }
  EXPECT_TRUE(rig.Step());
  EXPECT_EQ(rig.master.feedback(1).age_cycles, 0);
  EXPECT_EQ(rig.faults.faults().dropped, 3u);
  EXPECT_EQ(rig.faults.pending(), 0);
}

TEST(Faults, ANodeWhoseFramesAllGetLostIsLost) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kDrop, .at_s = 0.1, .for_s = 1, .node = 2});
  rig.Run(95);
  EXPECT_TRUE(rig.events.empty()) << "not yet";
  rig.Run(300);
  EXPECT_EQ(rig.Told(2), Codes{Status::kDriveLost}) << rig.Log();
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kOffline);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
  rig.Run(1000);
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kOffline) << "nothing resumes by itself";
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}

TEST(Faults, ABootSurvivesSomeLostSdoFramesAndNamesTheStepWhenAllAreLost) {
  Rig some(7);
  some.Order({.kind = FaultKind::kDrop, .node = 1, .cob_id = 0x581, .probability = 0.1});
  EXPECT_TRUE(some.RunUntil(DriveState::kReady)) << some.Log();
  EXPECT_GT(some.faults.faults().dropped, 3u);

  Rig all;
  all.Order({.kind = FaultKind::kDrop, .cob_id = 0x581});
  all.Run(3500);
  EXPECT_EQ(all.Told(1), Codes{Status::kBootFailed});
  EXPECT_THAT(all.Log(), HasSubstr("node 1: identity: read 1000:00: no answer (3 tries of 50 ms)"));
  EXPECT_EQ(all.master.feedback(0).state, DriveState::kOffline);
  EXPECT_EQ(all.master.feedback(1).state, DriveState::kReady);
}

TEST(Faults, LateFeedbackIsMissingInItsCycle) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kDelay, .cob_id = 0x183, .count = 1, .delay_s = 0.0005});
  EXPECT_FALSE(rig.Step());
  EXPECT_EQ(rig.master.feedback(2).age_cycles, 1);
  rig.clock.Advance(kNsPerMs / 2);
  rig.faults.Poll(rig.clock.Now());
  EXPECT_TRUE(rig.master.Poll(rig.clock.Now())) << "it comes half a millisecond later";
  EXPECT_EQ(rig.faults.faults().delayed, 1u);
}

TEST(Faults, SdoAnswersThatComeTooLateFailTheBoot) {
  Rig rig;
  rig.Order({.kind = FaultKind::kDelay, .cob_id = 0x582, .delay_s = 0.2});
  rig.Run(3500);
  EXPECT_EQ(rig.Told(2), Codes{Status::kBootFailed}) << rig.Log();
  EXPECT_THAT(rig.Log(), HasSubstr("node 2: identity: read 1000:00: no answer (3 tries of 50 ms)"));
}

TEST(Faults, TorqueThatIsLateActsLate) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kDelay,
             .node = 1,
             .direction = FrameDirection::kToDrives,
             .cob_id = 0x201,
             .delay_s = 0.010});
  rig.torques = {200, 200, 200};
  rig.Run(5);
  EXPECT_NEAR(rig.rack.torque_Nm(0), 0.1 * kRated_Nm, 1e-9);
  EXPECT_NEAR(rig.rack.torque_Nm(1), 0.2 * kRated_Nm, 1e-9);
  rig.Run(10);
  EXPECT_NEAR(rig.rack.torque_Nm(0), 0.2 * kRated_Nm, 1e-9);
}

TEST(Faults, EveryFrameTwiceChangesNothing) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kDuplicate});
  rig.Run(500);
  EXPECT_TRUE(rig.events.empty()) << rig.Log();
  EXPECT_NEAR(rig.rack.torque_Nm(2), 0.1 * kRated_Nm, 1e-9);
  EXPECT_GT(rig.faults.faults().duplicated, 5000u);
}

TEST(Faults, AfterSpoiltSdoFramesABootFailsByNameOrTheDriveTurnsAsTold) {
  // Single bits spoilt in requests or in answers: what was written is read back, so that a boot that ends
  // well has set currents and mappings as told; else the master says which step failed.
  int failed = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Rig rig(seed);
    rig.Order({.kind = FaultKind::kCorrupt,
               .node = 1,
               .direction = seed % 2 ? FrameDirection::kToDrives : FrameDirection::kFromDrives,
               .cob_id = seed % 2 ? 0x601u : 0x581u,
               .probability = 0.06});
    rig.Run(3500);
    ASSERT_GT(rig.faults.faults().corrupted, 0u);
    const DriveState state = rig.master.feedback(0).state;
    if (state == DriveState::kReady) {
      rig.request = DriveRequest::kEnable;
      rig.torques = {500, 500, 500};
      rig.Run(200);
      EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled) << seed << "\n" << rig.Log();
      EXPECT_NEAR(rig.rack.torque_Nm(0), 0.5 * kRated_Nm, 1e-9) << seed;
    } else {
      ++failed;
      EXPECT_FALSE(rig.Told(1).empty()) << seed;
    }
    EXPECT_EQ(rig.master.feedback(1).age_cycles, 0) << "the others do not suffer";
  }
  EXPECT_GT(failed, 0);
}

TEST(Faults, OneSeedGivesOneCourseOfEvents) {
  const auto course = [](std::uint64_t seed) {
    Rig rig(seed);
    rig.Order({.kind = FaultKind::kDrop, .probability = 0.05});
    rig.Order({.kind = FaultKind::kCorrupt, .probability = 0.02});
    rig.Order({.kind = FaultKind::kDelay, .probability = 0.05, .delay_s = 0.003});
    rig.request = DriveRequest::kEnable;
    rig.Run(3000);
    return rig.Course();
  };
  EXPECT_EQ(course(5), course(5));
  EXPECT_NE(course(5), course(6));
}

TEST(Faults, ProbabilityIsTheShareOfFrames) {
  Rig rig(3);
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kDrop, .cob_id = 0x181, .probability = 0.25});
  rig.Run(4000);
  // Binomial, 4000 of 0.25: 1000 with a standard deviation of 27.
  EXPECT_NEAR(static_cast<double>(rig.faults.faults().dropped), 1000, 5 * 27.4);
}

// ---- drives
// ----------------------------------------------------------------------------------------------------

TEST(Faults, ADriveThatDiesIsLostAndComesBackByOrderOnly) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kDie, .at_s = 0.05, .for_s = 1, .node = 3});
  rig.Run(60);
  EXPECT_EQ(rig.rack.torque_Nm(2), 0) << "no supply, no torque";
  EXPECT_GT(rig.master.feedback(2).age_cycles, 5);
  rig.Run(300);
  EXPECT_EQ(rig.Told(3), Codes{Status::kDriveLost}) << rig.Log();
  EXPECT_THAT(rig.Log(), HasSubstr("node 3: no heartbeat for 250 ms"));
  rig.Run(1000);
  EXPECT_EQ(rig.master.feedback(2).state, DriveState::kOffline);
  EXPECT_EQ(rig.rack.torque_Nm(2), 0);
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}

TEST(Faults, ARebootIsNoticedAtItsFirstFrame) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kReboot, .node = 1});
  rig.Run(2);
  EXPECT_EQ(rig.Told(1), Codes{Status::kDriveLost}) << rig.Log();
  EXPECT_THAT(rig.Log(), HasSubstr("node 1: unexpected boot-up"));
  EXPECT_EQ(rig.rack.torque_Nm(0), 0);
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}

TEST(Faults, AFrozenDriveKeepsItsTorqueAndIsLost) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kFreeze, .for_s = 0.6, .node = 2});
  rig.torques = {0, 0, 0};
  rig.Run(400);
  EXPECT_EQ(rig.Told(2), Codes{Status::kDriveLost}) << rig.Log();
  EXPECT_NEAR(rig.rack.torque_Nm(1), 0.1 * kRated_Nm, 1e-9);
  EXPECT_EQ(rig.rack.torque_Nm(0), 0);
  // Awake again, it finds the master's heartbeats missing or is booted by the operator: either lets go.
  rig.Run(300);
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}

class FaultsEmcy : public ::testing::TestWithParam<std::uint16_t> {};

TEST_P(FaultsEmcy, IsAFaultOfTheDriveThatNamesTheCode) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kEmcy, .node = 2, .code = GetParam()});
  rig.Run(20);
  EXPECT_EQ(rig.Told(2), Codes{Status::kDriveFault}) << rig.Log();
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kFault);
  EXPECT_EQ(rig.master.feedback(1).error_code, GetParam());
  EXPECT_EQ(rig.rack.torque_Nm(1), 0);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}
INSTANTIATE_TEST_SUITE_P(Codes, FaultsEmcy,
                         ::testing::Values(0x1000, 0x2310, 0x3210, 0x4210, 0x5113, 0x6320, 0x7320, 0x8130,
                                           0x81FD, 0x8611, 0x8A88),
                         [](const auto& i) {
                           char name[8];
                           std::snprintf(name, sizeof(name), "x%04X", i.param);
                           return std::string(name);
                         });

TEST(Faults, HeartbeatsThatStopLoseTheDriveThoughItsFeedbackComes) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kStopHeartbeat, .node = 1});
  rig.Run(100);
  EXPECT_TRUE(rig.events.empty());
  EXPECT_EQ(rig.master.feedback(0).age_cycles, 0);
  rig.Run(300);
  EXPECT_EQ(rig.Told(1), Codes{Status::kDriveLost}) << rig.Log();
  rig.Recovers();
  rig.Run(300);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline) << "it takes a reset of the drive";
  rig.Order({.kind = FaultKind::kReboot, .node = 1});
  rig.Run(5);
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}

TEST(Faults, SafeTorqueOffHoldsUntilItEndsAndIsClearedThenOnly) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kSto, .at_s = 0.01, .for_s = 3});  // of every drive: an emergency stop
  rig.Run(20);
  for (int i = 0; i < kDrives; ++i) {
    EXPECT_EQ(rig.rack.torque_Nm(i), 0);
    EXPECT_EQ(rig.master.feedback(i).state, DriveState::kFault);
    EXPECT_EQ(rig.master.feedback(i).error_code, 0x8A88);
    EXPECT_EQ(rig.Told(i + 1), Codes{Status::kDriveFault}) << rig.Log();
  }
  EXPECT_THAT(rig.Log(),
              HasSubstr("safe torque off: the STO inputs are not powered; release the emergency stop"));
  EXPECT_FALSE(rig.Recovers()) << "not while it lasts";
  for (int i = 0; i < kDrives; ++i) EXPECT_FALSE(rig.rack.enabled(i));
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}

TEST(Faults, EachHasItsOwnEnd) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  const auto shows = [&](int position) {
    for (int i = 0; i < kDrives; ++i) rig.rack.SetSensors(i, {.position_counts = position});
    rig.Step();
    return rig.master.feedback(0).position_counts;
  };
  EXPECT_EQ(shows(1), 1);
  rig.Order({.kind = FaultKind::kStickSensor, .for_s = 0.020, .node = 1, .sensor = DriveSensor::kEncoder});
  rig.Order({.kind = FaultKind::kStickSensor, .for_s = 0.010, .node = 1, .sensor = DriveSensor::kEncoder});
  rig.Order({.kind = FaultKind::kStickSensor, .for_s = 0.010, .node = 1, .sensor = DriveSensor::kTorque});
  rig.Step();
  rig.Run(14);
  EXPECT_EQ(shows(2), 1) << "the longer one lasts";
  rig.Run(8);
  EXPECT_EQ(shows(3), 3);

  rig.Order({.kind = FaultKind::kDie, .node = 2});  // for ever
  rig.Order({.kind = FaultKind::kDie, .for_s = 0.02, .node = 2});
  rig.Order({.kind = FaultKind::kFreeze, .for_s = 0.03, .node = 2});
  rig.Order({.kind = FaultKind::kReboot, .at_s = 0.05, .node = 2});
  rig.Run(600);
  rig.master.ClearFaults(rig.clock.Now());
  rig.Run(3500);
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kOffline) << "dead for ever";

  rig.Order({.kind = FaultKind::kBusOff, .for_s = 0.3});
  rig.Order({.kind = FaultKind::kBusOff, .for_s = 0.1});
  rig.Run(250);
  EXPECT_FALSE(rig.faults.up());
  rig.Run(60);
  EXPECT_TRUE(rig.faults.up());

  rig.Order({.kind = FaultKind::kSto, .for_s = 0.1});
  rig.Order({.kind = FaultKind::kSto, .for_s = 0.05, .node = 1});
  rig.Run(70);
  rig.master.ClearFaults(rig.clock.Now());
  EXPECT_EQ(rig.faults.pending(), 2) << "the death and the longer of the two";
}

TEST(Faults, ADriveThatComesBackFrozenStaysFrozen) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kFreeze, .for_s = 1, .node = 3});
  rig.Order({.kind = FaultKind::kReboot, .at_s = 0.1, .node = 3});
  rig.Order({.kind = FaultKind::kDie, .at_s = 0.2, .for_s = 0.1, .node = 3});
  int from_3 = 0;
  rig.Step();
  rig.bus.SetFilter([&](can::CanFrame& frame) {
    from_3 += frame.id == 0x183 || frame.id == 0x703;
    return true;
  });
  rig.Run(990);
  EXPECT_EQ(from_3, 0);
  rig.Run(20);
  EXPECT_EQ(from_3, 1) << "its boot-up";
}

class FaultsSensor : public ::testing::TestWithParam<DriveSensor> {};

TEST_P(FaultsSensor, AStuckOneShowsItsLastValueTheOthersGoOn) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  const auto show = [&](int k) {
    for (int i = 0; i < kDrives; ++i) {
      rig.rack.SetSensors(i, {.position_counts = 1000 * k,
                              .velocity_rpm = 0,
                              .actual_torque_Nm = 0.1 * k * kRated_Nm,
                              .analog_mV = {static_cast<std::int16_t>(50 * k), 0}});
    }
    rig.Step();
    const DriveFeedback& f = rig.master.feedback(1);
    return std::array<int, 3>{f.position_counts / 1000, f.analog_mV / 50, f.torque_permille / 100};
  };
  using Shown = std::array<int, 3>;
  EXPECT_EQ(show(1), (Shown{1, 1, 1}));
  rig.Order({.kind = FaultKind::kStickSensor, .for_s = 0.003, .node = 2, .sensor = GetParam()});
  Shown expected{2, 2, 2};
  rig.Step();
  expected[static_cast<std::size_t>(GetParam())] = 1;
  EXPECT_EQ(show(2), expected);
  EXPECT_EQ(rig.master.feedback(0).position_counts, 2000);
  rig.Run(3);
  EXPECT_EQ(show(3), (Shown{3, 3, 3})) << "free again";
  EXPECT_TRUE(rig.events.empty()) << rig.Log();
}
INSTANTIATE_TEST_SUITE_P(Kinds, FaultsSensor,
                         ::testing::Values(DriveSensor::kEncoder, DriveSensor::kLoadCell,
                                           DriveSensor::kTorque));

// ---- the bus
// ---------------------------------------------------------------------------------------------------

TEST(Faults, BusOffLosesEveryDriveAndNothingMovesUntilTold) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled()) << rig.Log();
  rig.Order({.kind = FaultKind::kBusOff, .at_s = 0.01, .for_s = 0.5});
  rig.Run(15);
  EXPECT_EQ(rig.Told(0), Codes{Status::kBusOff}) << rig.Log();
  EXPECT_FALSE(rig.master.bus_ok());
  for (int i = 0; i < kDrives; ++i) EXPECT_EQ(rig.master.feedback(i).state, DriveState::kOffline);
  rig.Run(300);
  for (int i = 0; i < kDrives; ++i) EXPECT_EQ(rig.rack.torque_Nm(i), 0) << "heartbeat consumer of the drive";
  rig.Run(500);
  EXPECT_TRUE(rig.master.bus_ok());
  EXPECT_THAT(rig.Log(), HasSubstr("the CAN interface is back"));
  for (int i = 0; i < kDrives; ++i) EXPECT_FALSE(rig.rack.enabled(i));
  EXPECT_TRUE(rig.Recovers()) << rig.Log();
}

}  // namespace
}  // namespace tendril::emulator
