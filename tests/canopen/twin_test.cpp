// Two drives with one node id on a memory bus: noticed while booting and later, named, and taken off; and a
// bus that loses, delays or repeats frames of single drives is not mistaken for it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>

#include "answer_watch.h"
#include "reply_watch.h"
#include "support/test_rack.h"
#include "tendril/can/memory_bus.h"
#include "tendril/canopen/master.h"
#include "tendril/canopen/wire.h"
#include "tendril/emulator/faults.h"

namespace tendril::canopen {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kTwin = 2;  // node id

/// Three drives, and on call a further one with the id of the second.
class Rig {
 public:
  explicit Rig(int drives = 3, std::uint64_t seed = 1)
      : drives_(drives),
        bus(clock),
        faults(bus.AddPort(), seed),
        rack(emulator::TestRack(drives), faults),
        master(TestBus(drives), TestDrives(drives), bus.AddPort()),
        torques(static_cast<std::size_t>(drives), 100) {
    faults.Attach(rack);
  }

  void PlugIn(std::uint32_t serial, std::int32_t position_counts) {
    auto parameters = emulator::TestRack(drives_)[kTwin - 1];
    parameters.serial = serial;
    twin = std::make_unique<emulator::DriveRack>(std::span(&parameters, 1), bus.AddPort());
    twin->SetSensors(0, {.position_counts = position_counts});
  }
  bool Step() {
    clock.Advance(kNsPerMs);
    // Motors never show quite the same.
    for (int i = 0; i < drives_; ++i)
      rack.SetSensors(i,
                      {.position_counts = ++counts_, .analog_mV = {static_cast<std::int16_t>(500 + i), 0}});
    master.BeginCycle(clock.Now());
    faults.Poll(clock.Now());
    rack.Poll(clock.Now());
    if (twin) twin->Poll(clock.Now());
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
      for (int k = 0; k < drives_; ++k) all &= master.feedback(k).state == state;
      if (all) return true;
    }
    return false;
  }
  bool Enabled() {
    master.Start(clock.Now());
    if (!RunUntil(DriveState::kReady)) return false;
    request = DriveRequest::kEnable;
    if (!RunUntil(DriveState::kEnabled, 200)) return false;
    Run(50);
    events.clear();
    return true;
  }
  DriveState state() const { return master.feedback(kTwin - 1).state; }
  std::vector<std::string> Texts(Status status) const {
    std::vector<std::string> texts;
    for (const BusEvent& event : events) {
      if (event.status == status) texts.emplace_back(event.text.data());
    }
    return texts;
  }

 private:
  int drives_;
  std::int32_t counts_ = 0;

 public:
  SimulatedClock clock{kNsPerS};
  can::MemoryBus bus;
  emulator::FaultInjector faults;
  emulator::DriveRack rack;
  std::unique_ptr<emulator::DriveRack> twin;
  Master master;
  DriveRequest request = DriveRequest::kDisable;
  std::vector<std::int16_t> torques;
  std::vector<BusEvent> events;
};

TEST(Twin, OfAnotherSerialNumberIsNamedWhileBooting) {
  Rig rig;
  rig.PlugIn(4712, 0);
  rig.master.Start(rig.clock.Now());
  rig.Run(1000);
  EXPECT_EQ(rig.state(), DriveState::kIdTwice);
  EXPECT_THAT(rig.Texts(Status::kNodeIdShared),
              ElementsAre("node 2: two drives have this node id: serial numbers 1 and 4712"));
  EXPECT_THAT(rig.Texts(Status::kDriveLost), IsEmpty()) << "two boot-up messages are no restart";
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kReady) << "the others are not held up";
  rig.request = DriveRequest::kEnable;
  rig.Run(500);
  EXPECT_FALSE(rig.rack.enabled(kTwin - 1));
  EXPECT_FALSE(rig.twin->enabled(0));
}

TEST(Twin, OfTheSameSerialNumberIsNamedByItsAnswers) {
  Rig rig;
  rig.PlugIn(1, 0);
  rig.master.Start(rig.clock.Now());
  rig.Run(1000);
  EXPECT_EQ(rig.state(), DriveState::kIdTwice);
  EXPECT_THAT(rig.Texts(Status::kNodeIdShared),
              ElementsAre(HasSubstr("8 SDO requests in a row were answered")));
}

TEST(Twin, ThatIsTakenAwayLetsTheOtherBootAfterClear) {
  Rig rig;
  rig.PlugIn(4712, 0);
  rig.master.Start(rig.clock.Now());
  rig.Run(1000);
  ASSERT_EQ(rig.state(), DriveState::kIdTwice);
  rig.twin->SetSupply(0, false);
  rig.master.ClearFaults(rig.clock.Now());
  EXPECT_TRUE(rig.RunUntil(DriveState::kReady));
}

// A drive that boots on a bus in use is one of the two that the master will then hear.
TEST(Twin, PluggedInUnderTorqueIsNamedAndBothAreTakenOff) {
  for (const int drives : {2, 3}) {
    Rig rig(drives);
    ASSERT_TRUE(rig.Enabled());
    rig.PlugIn(4712, 77);
    rig.Run(10);
    EXPECT_EQ(rig.state(), DriveState::kIdTwice);
    EXPECT_THAT(rig.Texts(Status::kNodeIdShared),
                ElementsAre(HasSubstr("still answers SYNC after the other's")));
    EXPECT_EQ(rig.rack.torque_Nm(kTwin - 1), 0) << "the first one does not live on with its last torque";
    EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
    rig.request = DriveRequest::kDisable;
    rig.master.ClearFaults(rig.clock.Now());
    rig.Run(1000);
    EXPECT_EQ(rig.state(), DriveState::kIdTwice) << "and is named again";
    EXPECT_THAT(rig.Texts(Status::kNodeIdShared).back(), HasSubstr("serial numbers 1 and 4712"));
  }
}

// Its cable was loose while the master started the first one, and both were operational.
TEST(Twin, ThatRunsAlreadyIsNamedWithinTwentyCyclesAndBothAreTakenOff) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled());
  can::CanPort& port = rig.bus.AddPort();
  for (int i = 0; i < 20; ++i) {
    rig.Step();
    can::CanFrame tpdo;
    tpdo.id = 0x182;
    tpdo.size = 8;
    tpdo.data = {1, 2, 3, 4, 0, 0, 0, static_cast<std::uint8_t>(i / 10)};
    port.Send(tpdo);
  }
  EXPECT_EQ(rig.state(), DriveState::kIdTwice);
  EXPECT_THAT(rig.Texts(Status::kNodeIdShared),
              ElementsAre("node 2: two drives have this node id: each SYNC is answered by two TPDO 0x182"));
  rig.Run(2);
  EXPECT_EQ(rig.rack.torque_Nm(kTwin - 1), 0);
  EXPECT_EQ(rig.master.feedback(0).state, DriveState::kEnabled);
}

TEST(Twin, ARestartOfOneDriveIsARestart) {
  Rig rig;
  ASSERT_TRUE(rig.Enabled());
  rig.rack.PowerCycle(kTwin - 1);
  rig.Run(500);
  EXPECT_EQ(rig.state(), DriveState::kOffline);
  EXPECT_THAT(rig.Texts(Status::kDriveLost), ElementsAre(HasSubstr("unexpected boot-up")));
  EXPECT_THAT(rig.Texts(Status::kNodeIdShared), IsEmpty());
}

// Whatever befalls the frames of single drives: late by less than what makes a drive lost, lost, repeated.
TEST(Twin, SingleDrivesOnABadBusAreNotMistaken) {
  for (const FaultKind kind : {FaultKind::kDelay, FaultKind::kDrop, FaultKind::kDuplicate}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      Rig rig(3, seed);
      ASSERT_TRUE(rig.Enabled());
      rig.faults.Add(
          {.kind = kind, .for_s = 1, .probability = 0.1 * static_cast<double>(seed), .delay_s = 0.02},
          rig.clock.Now());
      rig.Run(2500);
      EXPECT_THAT(rig.Texts(Status::kNodeIdShared), IsEmpty()) << static_cast<int>(kind) << " " << seed;
    }
  }
}

TEST(Twin, LostAndLateSdoFramesOfABootAreNotMistaken) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Rig rig(3, seed);
    const FaultKind kind = seed % 2 == 0 ? FaultKind::kDrop : FaultKind::kDelay;
    // Later than bus.sdo_timeout_ms, so that requests are repeated and both are answered.
    rig.faults.Add({.kind = kind, .probability = 0.05, .delay_s = 0.06}, rig.clock.Now());
    rig.master.Start(rig.clock.Now());
    rig.Run(3500);
    EXPECT_THAT(rig.Texts(Status::kNodeIdShared), IsEmpty()) << seed;
  }
}

// ---- the counts themselves ----------------------------------------------------------------------

AnswerWatch::Data Numbered(int n) {
  AnswerWatch::Data data{};
  PutLe(data, static_cast<std::uint64_t>(n), 8);
  return data;
}

TEST(AnswerWatch, TwoAnswersASyncAreCertainAfterSixteen) {
  AnswerWatch watch(250);
  int syncs = 0;
  for (bool certain = false; !certain && syncs < 100; ++syncs) {
    watch.OnSync();
    watch.OnAnswer(Numbered(syncs));
    certain = watch.OnAnswer(Numbered(1000 + syncs));
  }
  EXPECT_LE(syncs, 17);
}

TEST(AnswerWatch, LateLostAndRepeatedAnswersOfOneDriveNeverAre) {
  AnswerWatch watch(250);
  std::deque<int> waiting;
  for (int i = 0; i < 20000; ++i) {
    watch.OnSync();
    if (i % 7 != 0) waiting.push_back(i);
    // A reader or adapter that stands still for 200 SYNCs and then hands over everything at once.
    if (i % 1000 < 200) continue;
    while (!waiting.empty()) {
      EXPECT_FALSE(watch.OnAnswer(Numbered(waiting.front())));
      EXPECT_FALSE(watch.OnAnswer(Numbered(waiting.front()))) << "received twice";
      waiting.pop_front();
    }
  }
}

TEST(AnswerWatch, LostAnswersDelayTheCertaintyByNoMoreThanTheLatest) {
  AnswerWatch watch(250);
  for (int i = 0; i < 10000; ++i) watch.OnSync();
  int syncs = 0;
  for (bool certain = false; !certain && syncs < 1000; ++syncs) {
    watch.OnSync();
    watch.OnAnswer(Numbered(syncs));
    certain = watch.OnAnswer(Numbered(100000 + syncs));
  }
  EXPECT_LE(syncs, 250 + 17);
}

can::CanFrame Upload(std::uint16_t index) {
  SdoMessage message;
  message.kind = SdoKind::kInitiateUpload;
  message.address = {index, 0};
  return EncodeSdoRequest(1, message);
}

can::CanFrame Reply(std::uint16_t index, std::uint8_t value) {
  SdoMessage message;
  message.kind = SdoKind::kInitiateUpload;
  message.address = {index, 0};
  message.expedited = message.size_indicated = true;
  message.size = 1;
  message.data[0] = value;
  return EncodeSdoResponse(1, message);
}

using Surplus = ReplyWatch::Surplus;

TEST(ReplyWatch, ASecondReplyIsSurplusBeforeAndAfterTheNextRequest) {
  ReplyWatch watch;
  watch.OnRequest(Upload(0x6041));
  EXPECT_EQ(watch.OnReply(Reply(0x6041, 1)), Surplus::kNone);
  EXPECT_EQ(watch.OnReply(Reply(0x6041, 1)), Surplus::kAlike);
  watch.OnRequest(Upload(0x603F));
  EXPECT_EQ(watch.OnReply(Reply(0x6041, 2)), Surplus::kDifferent);
  EXPECT_EQ(watch.OnReply(Reply(0x603F, 9)), Surplus::kNone);
}

TEST(ReplyWatch, LateAndForeignRepliesAreNot) {
  ReplyWatch watch;
  EXPECT_EQ(watch.OnReply(Reply(0x6041, 7)), Surplus::kNone) << "to a request of an earlier master";
  watch.OnRequest(Upload(0x6041));
  watch.OnRequest(Upload(0x6041));  // it timed out, or another master asks the same
  EXPECT_EQ(watch.OnReply(Reply(0x6041, 1)), Surplus::kNone);
  EXPECT_EQ(watch.OnReply(Reply(0x6041, 2)), Surplus::kNone);
  EXPECT_EQ(watch.OnReply(Reply(0x2000, 2)), Surplus::kNone) << "to a request that was not heard";
  EXPECT_EQ(watch.OnReply(Reply(0x6041, 2)), Surplus::kAlike);
}

TEST(ReplyWatch, CountsRequestsInARow) {
  ReplyWatch watch;
  for (std::uint16_t i = 0; i < 6; ++i) {
    watch.OnRequest(Upload(static_cast<std::uint16_t>(0x2000 + i)));
    watch.OnReply(Reply(static_cast<std::uint16_t>(0x2000 + i), 1));
    if (i != 2) watch.OnReply(Reply(static_cast<std::uint16_t>(0x2000 + i), 1));
  }
  EXPECT_EQ(watch.in_a_row(), 3);
}

}  // namespace
}  // namespace tendril::canopen
