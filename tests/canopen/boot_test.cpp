// The boot of a drive: what is asked and written in which order, and what each failure says.
// Against a scripted node; the emulator has tests of its own.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "fake_node.h"

namespace tendril::canopen::test {
namespace {

using ::testing::ElementsAre;
using ::testing::ElementsAreArray;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(Boot, WritesExactlyThisInThisOrder) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  const std::vector<Write> expected = {
      // motor off, no old set value
      {Key(0x6040, 0), 0},
      {Key(0x6071, 0), 0},
      {Key(0x60B2, 0), 0},
      // motor data
      {Key(0x3001, 1), 360},
      {Key(0x3001, 2), 720},
      {Key(0x3001, 5), 19600},
      // stop reactions
      {Key(0x6007, 0), 2},
      {Key(0x605A, 0), 6},
      {Key(0x605B, 0), 0},
      {Key(0x605C, 0), 0},
      {Key(0x605E, 0), 0},
      {Key(0x1029, 1), 0},
      // interpolation off
      {Key(0x60C2, 1), 0},
      {Key(0x60C2, 2), 0xFD},
      // the drive watches node 127 for 250 ms and sends every 100 ms
      {Key(0x1016, 1), 0x007F00FA},
      {Key(0x1016, 2), 0},
      {Key(0x1017, 0), 100},
      // PDOs that nobody uses
      {Key(0x1401, 1), 0x80000301},
      {Key(0x1402, 1), 0x80000401},
      {Key(0x1403, 1), 0x80000501},
      {Key(0x1802, 1), 0xC0000381},
      {Key(0x1803, 1), 0xC0000481},
      // controlword and target torque
      {Key(0x1400, 1), 0x80000201},
      {Key(0x1400, 2), 1},
      {Key(0x1600, 0), 0},
      {Key(0x1600, 1), 0x60400010},
      {Key(0x1600, 2), 0x60710010},
      {Key(0x1600, 0), 2},
      {Key(0x1400, 1), 0x00000201},
      // position, torque, load cell
      {Key(0x1800, 1), 0xC0000181},
      {Key(0x1800, 2), 1},
      {Key(0x1800, 3), 0},
      {Key(0x1A00, 0), 0},
      {Key(0x1A00, 1), 0x60640020},
      {Key(0x1A00, 2), 0x60770010},
      {Key(0x1A00, 3), 0x31600110},
      {Key(0x1A00, 0), 3},
      {Key(0x1800, 1), 0x40000181},
      // statusword on change, at most every 10 ms
      {Key(0x1801, 1), 0xC0000281},
      {Key(0x1801, 2), 255},
      {Key(0x1801, 3), 100},
      {Key(0x1A01, 0), 0},
      {Key(0x1A01, 1), 0x60410010},
      {Key(0x1A01, 0), 1},
      {Key(0x1801, 1), 0x40000281},
      // cyclic synchronous torque
      {Key(0x6060, 0), 10},
  };
  EXPECT_THAT(rig.nodes[0]->writes, ElementsAreArray(expected));
  EXPECT_EQ(rig.nodes[0]->resets, 1);
  EXPECT_EQ(rig.nodes[0]->starts, 1);
  EXPECT_EQ(rig.nodes[0]->machine, DriveMachine::kSwitchOnDisabled);
  EXPECT_THAT(rig.Texts(Status::kOk),
              ElementsAre("node 1: configured: product 0x60500000, serial 4712, state switch on disabled"));
}

TEST(Boot, EveryWriteIsReadBack) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  // One request a write and one a read-back; what is only read is counted exactly, so that none goes missing.
  const int reads_only =
      6 /* identity */ + 1 /* rated torque */ + 8 /* COB-IDs */ + 1 /* 0x6061 */ + 2 /* state */;
  EXPECT_EQ(rig.nodes[0]->sdo_requests, 2 * static_cast<int>(rig.nodes[0]->writes.size()) + reads_only);
}

TEST(Boot, UnequalCobIdOfASavedConfigurationIsDisabledAsItIsFirst) {
  Rig rig(1);
  rig.nodes[0]->Set(0x1400, 1, 0x00000321);
  ASSERT_TRUE(rig.Ready());
  std::vector<std::uint32_t> values;
  for (const Write& write : rig.nodes[0]->writes) {
    if (write.key == Key(0x1400, 1)) values.push_back(write.value);
  }
  EXPECT_THAT(values, ElementsAre(0x80000321u, 0x00000201u));
}

TEST(Boot, MissedBootUpMessageIsMadeUpForByAsking) {
  Rig rig(1);
  rig.nodes[0]->says_boot_up = false;
  EXPECT_TRUE(rig.Ready());
}

TEST(Boot, DriveThatIsPoweredLateBootsWhenItComes) {
  Rig rig(1);
  rig.nodes[0]->powered = false;
  rig.master.Start(rig.clock.Now());
  rig.Steps(3100);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  EXPECT_THAT(
      rig.Texts(Status::kBootFailed),
      ElementsAre(
          "node 1: boot-up: no message and no answer to read 1000:00 in 3000 ms: check power, wiring, "
          "node id, bit rate"));
  rig.nodes[0]->powered = true;
  rig.nodes[0]->SayBootUp();
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
}

TEST(Boot, OneLostSdoFrameIsAskedForAgain) {
  Rig rig(1);
  int seen = 0;
  rig.bus.SetFilter([&](can::CanFrame& frame) { return frame.id != 0x581 || ++seen % 20 != 7; });
  EXPECT_TRUE(rig.Ready());
  EXPECT_GT(seen, 100);
}

TEST(Boot, LostNmtStartIsSentAgain) {
  Rig rig(1);
  int starts = 0;
  rig.bus.SetFilter(
      [&](can::CanFrame& frame) { return frame.id != 0 || frame.data[0] != 0x01 || ++starts > 1; });
  EXPECT_TRUE(rig.Ready());
  EXPECT_EQ(starts, 2);
}

TEST(Boot, RestartInTheMiddleBeginsAgain) {
  Rig rig(1);
  rig.master.Start(rig.clock.Now());
  rig.Steps(20);
  rig.nodes[0]->SayBootUp();
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
  EXPECT_THAT(rig.Texts(Status::kDriveLost), ElementsAre(HasSubstr("restarted during its boot")));
}

TEST(Boot, ThreeDrivesWithinHalfASecondAndWithinTheBus) {
  Rig rig(3);
  rig.master.Start(rig.clock.Now());
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady, 500));
  for (const auto& node : rig.nodes) EXPECT_EQ(node->nmt, NmtState::kOperational);
}

TEST(Boot, DriveInFaultIsConfiguredButNotReadyAndKeepsItsFault) {
  Rig rig(1);
  rig.nodes[0]->machine = DriveMachine::kFault;
  rig.nodes[0]->Set(0x603F, 0, 0x8130);
  rig.master.Start(rig.clock.Now());
  rig.Steps(500);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kFault);
  EXPECT_EQ(rig.master.feedback(0).error_code, 0x8130);
  EXPECT_EQ(rig.nodes[0]->machine, DriveMachine::kFault);
  EXPECT_THAT(rig.Texts(Status::kDriveFault), ElementsAre(HasSubstr("error 0x8130 heartbeat lost: clear")));
  rig.master.ClearFaults(rig.clock.Now());
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady, 50));
  EXPECT_EQ(rig.master.feedback(0).error_code, 0);
}

struct Failure {
  const char* name;
  std::function<void(FakeNode&)> spoil;
  Status status;
  DriveState state;
  const char* text;
};

class BootFailure : public ::testing::TestWithParam<Failure> {};

TEST_P(BootFailure, IsToldInFull) {
  Rig rig(2);
  GetParam().spoil(*rig.nodes[1]);
  rig.master.Start(rig.clock.Now());
  rig.Steps(3500);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kReady) << "the other drive is not held up";
  EXPECT_EQ(rig.master.feedback(1).state, GetParam().state);
  EXPECT_THAT(rig.Texts(GetParam().status), ElementsAre(std::string("node 2: ") + GetParam().text));
  for (const BusEvent& event : rig.events) {
    EXPECT_LT(std::string(event.text.data()).size(), event.text.size() - 1)
        << "cut off: " << event.text.data();
  }
}

INSTANTIATE_TEST_SUITE_P(
    Each, BootFailure,
    ::testing::Values(
        Failure{"NoDrive", [](FakeNode& n) { n.Set(0x1000, 0, 0x00030191); }, Status::kConfigurationMismatch,
                DriveState::kOtherDevice, "identity: 1000:00 is 0x30191, no CiA 402 drive"},
        Failure{"Vendor", [](FakeNode& n) { n.Set(0x1018, 1, 0x2B); }, Status::kConfigurationMismatch,
                DriveState::kOtherDevice, "identity: 1018:01 is 0x2B, expected 0xFB..0xFB (bus.identity)"},
        Failure{"Product", [](FakeNode& n) { n.Set(0x1018, 2, 0x65510000); }, Status::kConfigurationMismatch,
                DriveState::kOtherDevice,
                "identity: product code 1018:02 is 0x65510000, not one of bus.identity.product_codes"},
        Failure{"Revision", [](FakeNode& n) { n.Set(0x1018, 3, 0x02000000); }, Status::kConfigurationMismatch,
                DriveState::kOtherDevice,
                "identity: 1018:03 is 0x2000000, expected 0x1000000..0x1FFFFFF (bus.identity)"},
        Failure{"NoTorqueMode", [](FakeNode& n) { n.Set(0x6502, 0, 0x1A5); }, Status::kConfigurationMismatch,
                DriveState::kOtherDevice, "identity: 6502:00 is 0x1A5, no cyclic synchronous torque mode"},
        Failure{"WriteAborted", [](FakeNode& n) { n.abort_write[Key(0x3001, 2)] = 0x06090030; },
                Status::kBootFailed, DriveState::kMisconfigured,
                "motor data: write 3001:02 = 720: abort 06090030 value out of range"},
        Failure{"ReadAborted", [](FakeNode& n) { n.abort_read[Key(0x1018, 3)] = 0x06090011; },
                Status::kBootFailed, DriveState::kOtherDevice,
                "identity: read 1018:03: abort 06090011 sub-index does not exist"},
        Failure{"ReadBack", [](FakeNode& n) { n.shows[Key(0x1A00, 1)] = 0x60410010; },
                Status::kConfigurationMismatch, DriveState::kMisconfigured,
                "PDO mapping: 1A00:01 reads 0x60410010 after 0x60640020 was written"},
        Failure{"ReadBackSigned", [](FakeNode& n) { n.shows[Key(0x6007, 0)] = 0xFFFF; },
                Status::kConfigurationMismatch, DriveState::kMisconfigured,
                "stop reactions: 6007:00 reads -1 after 2 was written"},
        Failure{"Mute", [](FakeNode& n) { n.mute.insert(Key(0x1016, 1)); }, Status::kBootFailed,
                DriveState::kOffline, "heartbeat: write 1016:01 = 0x7F00FA: no answer (3 tries of 50 ms)"},
        Failure{"RatedTorque", [](FakeNode& n) { n.Set(0x6076, 0, 8000); }, Status::kConfigurationMismatch,
                DriveState::kMisconfigured,
                "rated torque: 6076:00 is 8000 uNm, expected 7056: rated_torque_Nm must be torque constant x "
                "nominal "
                "current"},
        Failure{"ModeNotTaken", [](FakeNode& n) { n.shows[Key(0x6061, 0)] = 1; }, Status::kBootFailed,
                DriveState::kMisconfigured, "mode: 6061:00 not settled within bus.boot_timeout_ms = 3000"},
        Failure{"NoFeedback", [](FakeNode& n) { n.sends_feedback = false; }, Status::kBootFailed,
                DriveState::kOffline, "NMT start: no TPDO 0x182 after SYNC in 3000 ms"},
        Failure{
            "Absent", [](FakeNode& n) { n.powered = false; }, Status::kBootFailed, DriveState::kOffline,
            "boot-up: no message and no answer to read 1000:00 in 3000 ms: check power, wiring, node id, bit "
            "rate"}),
    [](const auto& test) { return test.param.name; });

TEST(Construction, RefusesWhatDoesNotFit) {
  SimulatedClock clock;
  can::MemoryBus bus(clock);
  can::CanPort& port = bus.AddPort();
  const auto refusal = [&](const BusParameters& parameters, std::vector<DriveSetup> drives) -> std::string {
    try {
      Master master(parameters, drives, port);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(refusal(TestBus(3), TestDrives(3)), IsEmpty());
  EXPECT_EQ(refusal(TestBus(4), TestDrives(4)),
            "4 drives at bus.cycle_ns = 1000000 need 102 % of the CAN bus, more than bus.max_load = 80 %: at "
            "most 3 "
            "drives fit this cycle, these drives fit bus.cycle_ns = 2000000 or longer");
  EXPECT_THAT(refusal(TestBus(4, 2 * kNsPerMs), TestDrives(4)), IsEmpty());
  BusParameters early = TestBus(3);
  early.feedback_deadline_ns = 500'000;
  EXPECT_THAT(refusal(early, TestDrives(3)), HasSubstr("bus.feedback_deadline_ns: 500000 is too early"));
  EXPECT_THAT(refusal(TestBus(0), {}), HasSubstr("1..16 drives"));
  EXPECT_THAT(refusal(TestBus(1), {{127, 360, 720, 19600, 7056}}), HasSubstr("node ids are 1..126"));
  EXPECT_THAT(refusal(TestBus(2), {{5, 360, 720, 19600, 7056}, {5, 360, 720, 19600, 7056}}),
              HasSubstr("every node id may be used once"));
  EXPECT_THAT(refusal(TestBus(1), {{1, 360, 720, 19600, 0}}), HasSubstr("rated torque must be positive"));
}

}  // namespace
}  // namespace tendril::canopen::test
