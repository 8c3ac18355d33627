// The master's cycle: enabling, torque, feedback and its age, and the reaction to everything that can go
// wrong. Against scripted nodes in simulated time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "fake_node.h"

namespace tendril::canopen::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TEST(Enabling, WalksOneTransitionAtATime) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.Steps(3);
  rig.nodes[0]->controlwords.clear();
  rig.request = DriveRequest::kEnable;
  rig.torques = {250};
  ASSERT_TRUE(rig.StepUntil(DriveState::kEnabled, 50));
  rig.Steps(3);
  EXPECT_THAT(rig.nodes[0]->controlwords, ElementsAre(0x0006, 0x0007, 0x000F));
  EXPECT_EQ(rig.nodes[0]->target, 250);
  EXPECT_EQ(rig.nodes[0]->largest_target_while_off, 0);

  rig.request = DriveRequest::kDisable;
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady, 10));
  EXPECT_EQ(rig.nodes[0]->target, 0);
  EXPECT_EQ(rig.nodes[0]->machine, DriveMachine::kSwitchOnDisabled);
  EXPECT_THAT(rig.Texts(Status::kDriveFault), IsEmpty());
}

TEST(Enabling, NeedsADisableRequestFirst) {
  Rig rig(1);
  rig.request = DriveRequest::kEnable;  // left over from before
  rig.torques = {250};
  rig.master.Start(rig.clock.Now());
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady));
  rig.Steps(100);
  EXPECT_EQ(rig.nodes[0]->machine, DriveMachine::kSwitchOnDisabled);
  EXPECT_EQ(rig.nodes[0]->target, 0);
  rig.request = DriveRequest::kDisable;
  rig.Step();
  rig.request = DriveRequest::kEnable;
  EXPECT_TRUE(rig.StepUntil(DriveState::kEnabled, 50));
}

TEST(Enabling, ShortDisableRequestIsCarriedOutAndIsNoFault) {
  Rig rig(1);
  rig.nodes[0]->inhibit_ns = 10 * kNsPerMs;
  ASSERT_TRUE(rig.Enabled());
  rig.torques = {100};
  rig.Steps(5);
  rig.nodes[0]->controlwords.clear();
  rig.request = DriveRequest::kDisable;
  rig.Step();
  rig.request = DriveRequest::kEnable;  // while the statusword still shows the old state
  rig.Steps(60);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
  EXPECT_THAT(rig.nodes[0]->controlwords, ElementsAre(0x0000, 0x0006, 0x0007, 0x000F));
  EXPECT_EQ(rig.nodes[0]->largest_target_while_off, 0);
  EXPECT_THAT(rig.Texts(Status::kDriveFault), IsEmpty());
}

TEST(Enabling, LostStatuswordIsReadAgain) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.Steps(3);
  rig.bus.SetFilter([](can::CanFrame& frame) { return frame.id != 0x281; });  // no statusword TPDO at all
  rig.request = DriveRequest::kEnable;
  EXPECT_TRUE(rig.StepUntil(DriveState::kEnabled, 1000));
}

TEST(Enabling, DriveThatDoesNotMoveIsAFault) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.Step();
  rig.request = DriveRequest::kEnable;
  rig.torques = {100};
  rig.nodes[0]->machine = DriveMachine::kReadyToSwitchOn;
  rig.nodes[0]->obeys = false;
  rig.Steps(2100);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kFault);
  EXPECT_THAT(rig.Texts(Status::kDriveFault),
              ElementsAre("node 1: enabling: stuck in ready to switch on (statusword 0x0021)"));
}

TEST(Torque, ActsAtTheNextSync) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.torques = {111};
  rig.Step();
  EXPECT_EQ(rig.nodes[0]->target, 0) << "sent after this cycle's SYNC";
  rig.torques = {-222};
  rig.Step();
  EXPECT_EQ(rig.nodes[0]->target, 111);
  rig.Step();
  EXPECT_EQ(rig.nodes[0]->target, -222);
}

TEST(Torque, IsZeroUnlessEnabled) {
  Rig rig(3);
  ASSERT_TRUE(rig.Ready());
  rig.torques = {500, 500, 500};
  rig.Steps(50);
  for (const auto& node : rig.nodes) EXPECT_EQ(node->target, 0);
  rig.request = DriveRequest::kEnable;
  ASSERT_TRUE(rig.StepUntil(DriveState::kEnabled, 50));
  rig.Steps(2);
  for (const auto& node : rig.nodes) {
    EXPECT_EQ(node->target, 500);
    EXPECT_EQ(node->largest_target_while_off, 0);
  }
  // One drive drops out: its torque is zero at once, the others keep theirs.
  rig.nodes[1]->SayEmcy(0x2310, 0x02);
  rig.Steps(3);
  EXPECT_EQ(rig.nodes[0]->target, 500);
  EXPECT_EQ(rig.nodes[1]->target, 0);
  EXPECT_EQ(rig.nodes[1]->controlwords.back(), 0x0000);
  EXPECT_EQ(rig.nodes[2]->target, 500);
}

TEST(Feedback, CarriesSignedValuesOfTheRightDrive) {
  Rig rig(3);
  ASSERT_TRUE(rig.Ready());
  rig.nodes[0]->position = -2'000'000'000;
  rig.nodes[1]->torque = -999;
  rig.nodes[2]->analog = -5000;
  EXPECT_TRUE(rig.Step());
  EXPECT_EQ(rig.master.feedback(0).position_counts, -2'000'000'000);
  EXPECT_EQ(rig.master.feedback(1).torque_permille, -999);
  EXPECT_EQ(rig.master.feedback(2).analog_mV, -5000);
  EXPECT_EQ(rig.master.feedback(1).analog_mV, 0);
}

TEST(Feedback, MissingFramesAge) {
  Rig rig(2);
  ASSERT_TRUE(rig.Ready());
  EXPECT_TRUE(rig.Step());
  rig.nodes[1]->position = 7;
  EXPECT_TRUE(rig.Step());
  rig.nodes[1]->sends_feedback = false;
  rig.nodes[1]->position = 8;
  for (int i = 1; i <= 4; ++i) {
    EXPECT_FALSE(rig.Step());
    EXPECT_EQ(rig.master.feedback(0).age_cycles, 0);
    EXPECT_EQ(rig.master.feedback(1).age_cycles, i);
    EXPECT_EQ(rig.master.feedback(1).position_counts, 7) << "the last known value stays";
  }
  rig.nodes[1]->sends_feedback = true;
  EXPECT_TRUE(rig.Step());
  EXPECT_EQ(rig.master.feedback(1).age_cycles, 0);
  EXPECT_EQ(rig.master.feedback(1).position_counts, 8);
}

TEST(Feedback, OfTheLastCycleIsNotTakenForThisOne) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  // The answer to this SYNC comes after the cycle has ended; the next SYNC gets no answer.
  rig.clock.Advance(rig.cycle_ns);
  rig.master.BeginCycle(rig.clock.Now());
  EXPECT_FALSE(rig.master.Poll(rig.clock.Now()));
  rig.master.EndCycle(rig.clock.Now(), DriveRequest::kDisable, rig.torques);
  rig.nodes[0]->position = 5;
  rig.PollNodes();
  rig.clock.Advance(rig.cycle_ns);
  rig.master.BeginCycle(rig.clock.Now());
  EXPECT_FALSE(rig.master.Poll(rig.clock.Now()));
  EXPECT_EQ(rig.master.feedback(0).age_cycles, 1);
  EXPECT_EQ(rig.master.feedback(0).position_counts, 5);
}

TEST(Feedback, ShortTpdoIsRefusedAndTold) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.bus.SetFilter([](can::CanFrame& frame) {
    if (frame.id == 0x181) frame.size = 6;
    return true;
  });
  rig.nodes[0]->position = 99;
  rig.Steps(5);
  EXPECT_EQ(rig.master.feedback(0).age_cycles, 5);
  EXPECT_NE(rig.master.feedback(0).position_counts, 99);
  EXPECT_THAT(rig.Texts(Status::kFrameMalformed),
              ElementsAre("node 1: TPDO 0x181 ignored: 6 bytes, 63 00 00 00 00 00, expected 8 with known "
                          "contents (1 such frames since start)"));
}

TEST(Frames, MalformedOnesAreCountedAndToldOnceASecond) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  const auto send = [&](std::uint32_t id, std::uint8_t size, std::uint8_t first) {
    can::CanFrame frame;
    frame.id = id;
    frame.size = size;
    frame.data[0] = first;
    rig.nodes[0]->SendFrame(frame);
  };
  send(0x181, 3, 0x37);  // feedback
  send(0x281, 1, 0x37);  // statusword
  send(0x281, 8, 0x37);
  send(0x081, 5, 0x10);  // EMCY
  send(0x701, 1, 0x42);  // heartbeat of no state
  send(0x701, 2, 0x05);
  send(0x581, 7, 0x43);  // SDO response
  rig.Steps(3);
  EXPECT_EQ(rig.master.frame_faults().malformed, 7u);
  EXPECT_EQ(rig.master.frame_faults().foreign, 0u);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled) << "what cannot be read harms nobody";
  ASSERT_THAT(rig.Texts(Status::kFrameMalformed), SizeIs(1));
  EXPECT_THAT(rig.Texts(Status::kFrameMalformed)[0],
              HasSubstr("node 1: TPDO 0x181 ignored: 3 bytes, 37 00 00"));
  rig.Steps(1000);
  send(0x281, 0, 0);
  rig.Steps(2);
  ASSERT_THAT(rig.Texts(Status::kFrameMalformed), SizeIs(2));
  EXPECT_THAT(rig.Texts(Status::kFrameMalformed)[1], HasSubstr("0 bytes, none, expected 2"));
  EXPECT_THAT(rig.Texts(Status::kFrameMalformed)[1], HasSubstr("(8 such frames since start)"));
}

TEST(Frames, OnlyTheMasterMaySendAreToldWhenTheyComeFromElsewhere) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  can::CanFrame torque;
  torque.id = 0x201;
  torque.size = 4;
  can::CanFrame other_torque = torque;
  other_torque.id = 0x212;  // of a drive that is not ours
  for (const can::CanFrame& frame :
       {SyncFrame(), torque, other_torque, NmtFrame(NmtCommand::kStart, 9),
        HeartbeatFrame(127, NmtState::kOperational), HeartbeatFrame(9, NmtState::kOperational)}) {
    rig.nodes[0]->SendFrame(frame);
  }
  rig.Steps(3);
  EXPECT_EQ(rig.master.frame_faults().foreign, 4u);
  EXPECT_EQ(rig.master.frame_faults().malformed, 0u);
  ASSERT_THAT(rig.Texts(Status::kForeignFrame), SizeIs(1));
  EXPECT_THAT(rig.Texts(Status::kForeignFrame)[0], HasSubstr("SYNC 0x080 came from another sender"));
}

TEST(Events, EachEmergencyTellsItsRemedyWhole) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  const std::span<const EmcyInfo> table = Epos4Profile()->emcy;
  for (const EmcyInfo& info : table) {
    if (info.last == 0) continue;
    rig.events.clear();
    rig.nodes[0]->SayEmcy(info.last, 0xFF);
    rig.Steps(2);
    ASSERT_FALSE(rig.events.empty());
    const EmcyInfo& told = FindEmcy(table, info.last);
    EXPECT_TRUE(
        std::string(rig.events[0].text.data()).ends_with(std::string(told.cause) + "; " + told.remedy))
        << rig.events[0].text.data();
  }
}

TEST(Sync, OnlyWhenSomebodyIsStarted) {
  Rig rig(1);
  int syncs = 0;
  rig.bus.SetFilter([&](can::CanFrame& frame) {
    syncs += frame.id == 0x080;
    return true;
  });
  rig.nodes[0]->powered = false;
  rig.master.Start(rig.clock.Now());
  rig.Steps(100);
  EXPECT_EQ(syncs, 0);
  rig.nodes[0]->powered = true;
  rig.nodes[0]->SayBootUp();
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady));
  const int before = syncs;
  rig.Steps(100);
  EXPECT_EQ(syncs - before, 100);
}

TEST(Heartbeat, OfTheMasterComesAtItsRate) {
  Rig rig(1);
  int beats = 0;
  rig.bus.SetFilter([&](can::CanFrame& frame) {
    if (frame.id == 0x77F) {
      ++beats;
      EXPECT_EQ(frame.size, 1);
      EXPECT_EQ(frame.data[0], 0x05);
    }
    return true;
  });
  rig.master.Start(rig.clock.Now());
  rig.Step();
  EXPECT_EQ(beats, 1) << "the first at once, so that drives begin to watch";
  rig.Steps(1000);
  EXPECT_EQ(beats, 11);
}

TEST(Loss, OfHeartbeatTakesTheNodeOutAndLeavesTheOthers) {
  Rig rig(3);
  ASSERT_TRUE(rig.Enabled());
  rig.torques = {100, 100, 100};
  rig.nodes[1]->powered = false;
  rig.Steps(400);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kOffline);
  EXPECT_EQ(rig.master.feedback(2).state, DriveState::kEnabled);
  EXPECT_GE(rig.master.feedback(1).age_cycles, 399);
  EXPECT_EQ(rig.nodes[0]->target, 100);
  EXPECT_THAT(rig.Texts(Status::kDriveLost), ElementsAre("node 2: no heartbeat for 250 ms"));
}

TEST(Loss, ComesBackOnlyWhenClearedAndArmedAnew) {
  Rig rig(3);
  ASSERT_TRUE(rig.Enabled());
  rig.torques = {100, 100, 100};
  rig.nodes[1]->powered = false;
  rig.Steps(400);
  rig.nodes[1]->powered = true;
  rig.nodes[1]->machine = DriveMachine::kFault;  // it lost our heartbeat as well
  rig.nodes[1]->Set(0x603F, 0, 0x8130);
  rig.nodes[1]->SayBootUp();
  rig.Steps(500);
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kOffline) << "nothing resumes by itself";

  // Recovery while the others run: never more than one SDO request a cycle, and no TPDO of theirs is late.
  int sdo_frames = 0;
  rig.bus.SetFilter([&](can::CanFrame& frame) {
    sdo_frames += frame.id == 0x602;
    return true;
  });
  rig.master.ClearFaults(rig.clock.Now());
  for (int i = 0; i < 300; ++i) {
    sdo_frames = 0;
    rig.Step();
    EXPECT_LE(sdo_frames, 1);
    EXPECT_EQ(rig.master.feedback(0).age_cycles, 0);
    EXPECT_EQ(rig.master.feedback(2).age_cycles, 0);
    EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
  }
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kReady);
  EXPECT_EQ(rig.nodes[1]->resets, 2);
  EXPECT_EQ(rig.nodes[1]->machine, DriveMachine::kSwitchOnDisabled)
      << "ready, not enabled: the request never left enable";
  EXPECT_EQ(rig.nodes[1]->target, 0);

  rig.request = DriveRequest::kDisable;
  rig.Step();
  rig.request = DriveRequest::kEnable;
  EXPECT_TRUE(rig.StepUntil(DriveState::kEnabled, 50));
}

TEST(Loss, TwoRecoveriesShareWhatTheCycleLeaves) {
  Rig rig(3);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[1]->powered = rig.nodes[2]->powered = false;
  rig.Steps(400);
  rig.nodes[1]->powered = rig.nodes[2]->powered = true;
  int bits = 0;
  rig.bus.SetFilter([&](can::CanFrame& frame) {
    if (frame.id == 0x602 || frame.id == 0x603) bits += 2 * 135;  // a request and its answer
    if (frame.id == 0x000) bits += 75;
    return true;
  });
  rig.master.ClearFaults(rig.clock.Now());
  for (int i = 0; i < 600; ++i) {
    bits = 0;
    rig.Step();
    EXPECT_LE(bits, 800 - 55 - 230) << "of 1000, 80 % may be used; SYNC and one drive's PDOs go on";
    EXPECT_EQ(rig.master.feedback(0).age_cycles, 0);
  }
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kReady);
  EXPECT_EQ(rig.master.feedback(2).state, DriveState::kReady);
}

TEST(Loss, UnexpectedBootUp) {
  Rig rig(2);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[0]->machine = DriveMachine::kSwitchOnDisabled;
  rig.nodes[0]->SayBootUp();
  rig.Steps(2);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  EXPECT_THAT(rig.Texts(Status::kDriveLost), ElementsAre(HasSubstr("node 1: unexpected boot-up")));
  rig.request = DriveRequest::kDisable;
  rig.master.ClearFaults(rig.clock.Now());
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
}

TEST(Loss, NmtStateChangedByItself) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.Steps(100);
  rig.nodes[0]->nmt = NmtState::kPreOperational;
  rig.Steps(101);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  EXPECT_THAT(rig.Texts(Status::kDriveLost),
              ElementsAre("node 1: NMT state changed to pre-operational without a request"));
}

TEST(Fault, EmcyIsExplainedAndLatches) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[0]->machine = DriveMachine::kFault;
  rig.nodes[0]->SayEmcy(0x4380, 0x08);
  rig.Steps(2);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kFault);
  EXPECT_EQ(rig.master.feedback(0).error_code, 0x4380);
  EXPECT_THAT(
      rig.Texts(Status::kDriveFault),
      ElementsAre(HasSubstr("node 1: EMCY 0x4380 (register 0x08) motor thermal overload: current above")));
  rig.Steps(100);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kFault);
}

TEST(Fault, ResetIsOneRisingEdgeAndNothingMoves) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[0]->machine = DriveMachine::kFault;
  rig.nodes[0]->SayEmcy(0x4380, 0x08);
  rig.Steps(5);
  rig.nodes[0]->controlwords.clear();
  rig.master.ClearFaults(rig.clock.Now());
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady, 20));
  rig.Steps(100);  // still asked to enable
  EXPECT_EQ(rig.nodes[0]->machine, DriveMachine::kSwitchOnDisabled);
  EXPECT_THAT(rig.nodes[0]->controlwords, ElementsAre(0x0080, 0x0000));
  EXPECT_EQ(rig.nodes[0]->resets, 1) << "no new boot where the node was not lost";
  EXPECT_EQ(rig.master.feedback(0).error_code, 0);
}

TEST(Fault, ThatWillNotGoIsToldAfterOneNewBoot) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[0]->machine = DriveMachine::kFault;
  rig.nodes[0]->accepts_fault_reset = false;
  rig.Steps(5);
  rig.events.clear();
  rig.master.ClearFaults(rig.clock.Now());
  rig.Steps(4000);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kFault);
  EXPECT_EQ(rig.nodes[0]->resets, 2);
  EXPECT_THAT(
      rig.Texts(Status::kDriveFault),
      ElementsAre(HasSubstr("still in fault (statusword 0x0008, error 0x0000 no error): booting it again"),
                  HasSubstr("fault reset: still in fault")));
}

TEST(Fault, LeavingOperationEnabledByItself) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.Steps(3);
  rig.nodes[0]->machine = DriveMachine::kSwitchOnDisabled;
  rig.Steps(50);
  EXPECT_EQ(rig.nodes[0]->machine, DriveMachine::kSwitchOnDisabled) << "not enabled again by itself";
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kFault);
  EXPECT_THAT(
      rig.Texts(Status::kDriveFault),
      ElementsAre("node 1: left operation enabled by itself: switch on disabled (statusword 0x0040)"));
  rig.request = DriveRequest::kDisable;
  rig.master.ClearFaults(rig.clock.Now());
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady, 10));
}

TEST(Fault, QuickStopIsShownAsSuch) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.Steps(3);
  rig.nodes[0]->obeys = false;
  rig.nodes[0]->machine = DriveMachine::kQuickStopActive;
  rig.Steps(2);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kQuickStop);
  EXPECT_THAT(rig.Texts(Status::kDriveFault), SizeIs(1));
}

TEST(Fault, InternalLimitAndWarningAreToldOnce) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[0]->extra_bits = statusword::kInternalLimit | statusword::kWarning;
  rig.Steps(5);
  rig.nodes[0]->extra_bits |= statusword::kFollowsCommand;  // another bit changes: nothing new about these
  rig.Steps(5);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
  EXPECT_THAT(rig.Texts(Status::kLimitedByDrive), SizeIs(1));
  EXPECT_THAT(rig.Texts(Status::kDriveWarning), SizeIs(1));
}

TEST(Bus, OffLosesEveryDriveAndComesBackDisarmed) {
  Rig rig(2);
  ASSERT_TRUE(rig.Enabled());
  EXPECT_TRUE(rig.master.bus_ok());
  rig.bus.SetBusOff(true);
  EXPECT_FALSE(rig.master.bus_ok());
  rig.Steps(10);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  EXPECT_THAT(rig.Texts(Status::kBusOff), SizeIs(1));
  rig.bus.SetBusOff(false);
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady)) << "booted again";
  EXPECT_TRUE(rig.master.bus_ok());
  rig.Steps(100);
  EXPECT_EQ(rig.master.feedback(1).state, DriveState::kReady) << "the old enable request does not count";
}

can::CanFrame BusOffFrame() {
  can::CanFrame frame;
  frame.error = true;
  frame.size = 8;
  frame.id = can::kErrorBusOff;
  return frame;
}

TEST(Bus, OffWithoutARestartByTheKernelIsRestartedByUs) {
  Rig rig(2);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[0]->SendFrame(BusOffFrame());  // and nobody ever tells of a restart
  rig.Steps(1000);
  EXPECT_FALSE(rig.master.bus_ok());
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  rig.Steps(600);
  EXPECT_TRUE(rig.master.bus_ok());
  ASSERT_TRUE(rig.StepUntil(DriveState::kReady)) << "booted again";
  rig.Steps(100);
  EXPECT_EQ(rig.nodes[0]->machine, DriveMachine::kSwitchOnDisabled) << "disarmed until told otherwise";
  EXPECT_THAT(rig.Texts(Status::kBusOff), ElementsAre("the CAN interface went bus-off: every drive is lost"));
}

TEST(Bus, RestartsAreCountedAndEndInAStatusThatClearTakesAway) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.bus.SetBusOff(true);
  rig.Steps(60'000);
  const auto told = rig.Texts(Status::kBusOff);
  ASSERT_THAT(told, SizeIs(1 + 5 + 1));
  EXPECT_THAT(told[5], HasSubstr("restart 5 of 5 requested: not running yet"));
  EXPECT_THAT(told[5], HasSubstr("ip link set memory type can restart-ms 100"));
  EXPECT_THAT(told[6], HasSubstr("given up until clear"));
  rig.bus.SetBusOff(false);
  rig.Steps(5000);
  EXPECT_FALSE(rig.master.bus_ok());
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  rig.master.ClearFaults(rig.clock.Now());
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
  EXPECT_TRUE(rig.master.bus_ok());
}

TEST(Bus, ThatGoesOffAgainAndAgainIsLeftAlone) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.nodes[0]->says_boot_up = false;
  const int resets_before = rig.nodes[0]->resets;
  for (int i = 0; i < 100; ++i) {  // a kernel that restarts a short-circuited bus for ever
    rig.bus.SetBusOff(true);
    rig.Steps(50);
    rig.bus.SetBusOff(false);
    rig.Steps(50);
  }
  EXPECT_FALSE(rig.master.bus_ok());
  EXPECT_EQ(rig.nodes[0]->resets - resets_before, 5) << "bounded";
  EXPECT_THAT(rig.Texts(Status::kBusOff).back(), HasSubstr("given up until clear"));
  rig.master.ClearFaults(rig.clock.Now());
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
  // A bus that was steady since has all its restarts again.
  rig.Steps(3000);
  for (int i = 0; i < 5; ++i) {
    rig.bus.SetBusOff(true);
    rig.Steps(50);
    rig.bus.SetBusOff(false);
    ASSERT_TRUE(rig.StepUntil(DriveState::kReady));
  }
}

TEST(Bus, ThatWasGivenUpIsTriedAgainByAStart) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.bus.SetBusOff(true);
  rig.Steps(10'000);
  ASSERT_THAT(rig.Texts(Status::kBusOff).back(), HasSubstr("given up until clear"));
  rig.bus.SetBusOff(false);
  EXPECT_TRUE(rig.Ready());
}

TEST(Bus, OffAndRestartedWithinACycleIsNoticed) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.bus.SetBusOff(true);
  rig.bus.SetBusOff(false);
  rig.Steps(1);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  EXPECT_THAT(rig.Texts(Status::kBusOff), SizeIs(1));
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
}

TEST(Bus, RestartHeardAfterOursBootsTheDrivesThatCouldNotBeReached) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  rig.nodes[0]->says_boot_up = false;
  rig.nodes[0]->SendFrame(BusOffFrame());
  rig.nodes[0]->powered = false;
  rig.Steps(6000);  // ours came, the boot failed
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kOffline);
  rig.nodes[0]->powered = true;
  can::CanFrame restarted = BusOffFrame();
  restarted.id = can::kErrorRestarted;
  rig.nodes[0]->SendFrame(restarted);
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
}

TEST(Bus, ThatComesUpLateBootsTheDrives) {
  Rig rig(1);
  rig.bus.SetBusOff(true);
  rig.master.Start(rig.clock.Now());
  rig.Steps(100);
  rig.bus.SetBusOff(false);
  EXPECT_TRUE(rig.StepUntil(DriveState::kReady));
}

TEST(Bus, FullQueueIsToldAndNeverBlocks) {
  class FullPort final : public can::CanPort {
   public:
    bool Send(const can::CanFrame&) noexcept override { return false; }
    int Receive(std::span<can::StampedFrame>) noexcept override { return 0; }
    bool WaitUntil(TimeNs) noexcept override { return false; }
    bool up() const noexcept override { return true; }
    const can::CanCounters& counters() const noexcept override { return counters_; }

   private:
    can::CanCounters counters_;
  } port;
  Master master(TestBus(1), TestDrives(1), port);
  master.Start(0);
  for (TimeNs t = 0; t < 500 * kNsPerMs; t += kNsPerMs) master.BeginCycle(t);
  BusEvent event;
  int told = 0;
  while (master.PopEvent(&event)) told += event.status == Status::kFrameNotSent;
  EXPECT_EQ(told, 1) << "once a second, not once a frame";
}

TEST(Events, BeyondTheRingAreCounted) {
  Rig rig(1);
  ASSERT_TRUE(rig.Ready());
  for (int i = 0; i < 300; ++i) rig.nodes[0]->SayEmcy(0x4380, 0x08);
  rig.master.Poll(rig.clock.Now());
  EXPECT_EQ(rig.master.events_lost(), 300u - 128u);
}

TEST(Shutdown, DisablesReleasesTheHeartbeatAndStops) {
  Rig rig(2);
  ASSERT_TRUE(rig.Enabled());
  rig.torques = {100, 100};
  rig.Steps(3);
  bool done = false;
  int calls = 0;
  for (; calls < 2000 && !done; ++calls) {
    rig.clock.Advance(rig.cycle_ns);
    done = rig.master.Shutdown(rig.clock.Now());
    rig.PollNodes();
  }
  EXPECT_TRUE(done);
  EXPECT_LT(calls, 100);
  for (const auto& node : rig.nodes) {
    EXPECT_EQ(node->machine, DriveMachine::kSwitchOnDisabled);
    EXPECT_EQ(node->target, 0);
    EXPECT_EQ(node->Get(0x1016, 1), 0u) << "our silence must not be a fault";
    EXPECT_EQ(node->stops, 1);
  }
  EXPECT_TRUE(rig.master.Shutdown(rig.clock.Now()));
}

TEST(Shutdown, EndsWithoutAnAnswer) {
  Rig rig(1);
  ASSERT_TRUE(rig.Enabled());
  rig.nodes[0]->powered = false;
  bool done = false;
  int calls = 0;
  for (; calls < 3000 && !done; ++calls) {
    rig.clock.Advance(rig.cycle_ns);
    done = rig.master.Shutdown(rig.clock.Now());
  }
  EXPECT_TRUE(done);
  EXPECT_LT(calls, 700);
}

}  // namespace
}  // namespace tendril::canopen::test
