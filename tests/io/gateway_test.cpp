// The gateway on memq://: commands in, messages out, rubbish counted.
#include "tendril/io/gateway.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <lcm/lcm-cpp.hpp>
#include <thread>
#include <vector>

#include "random_record.h"
#include "tendril/io/client.h"
#include "tendril/io/epoch.h"
#include "tendril/io/wire.h"

namespace tendril::io {
namespace {

using testing::HasSubstr;

struct GatewayTest : testing::Test {
  static LcmParameters Parameters() { return {"memq://", "TENDRIL", 1, 1}; }

  GatewayTest() {
    gateway.OnCommand([this](const Command& c) { commands.push_back(c); });
    client.OnState([this](const tendril_lcm::state_t& s) { states.push_back(s); });
    client.OnEvent([this](const tendril_lcm::event_t& e) { events.push_back(e); });
  }

  // What is in flight, and what handling it sets off.
  void Settle() {
    while (gateway.Handle(0) > 0) {
    }
  }

  SimulatedClock clock{5 * kNsPerS};
  Gateway gateway{Parameters(), kShape, clock};
  Client client{gateway.lcm(), "TENDRIL"};
  std::vector<Command> commands;
  std::vector<tendril_lcm::state_t> states;
  std::vector<tendril_lcm::event_t> events;
};

Command Bending() {
  Command c;
  c.kind = CommandKind::kBending;
  c.sequence = 3;
  c.valid_for_ns = kNsPerS / 4;
  c.bending_rad = Eigen::Vector2d(0.1, -0.2);
  c.bending_rate_radps = Eigen::Vector2d(0.3, 0.4);
  c.speed_radps = 0.5;
  return c;
}

TEST_F(GatewayTest, WhatADaemonWaitsForIsRemembered) {
  gateway.PublishEvent(1, Status::kDegraded, "bus", "waiting: for a drive");
  Settle();
  EXPECT_EQ(client.waits(), "");
  gateway.PublishEvent(1, Status::kDegraded, "daemon", "waiting: no can0");
  gateway.PublishEvent(1, Status::kDegraded, "daemon", "something else");
  Settle();
  EXPECT_EQ(client.waits(), "waiting: no can0");
  EXPECT_EQ(events.size(), 3u);
}

TEST_F(GatewayTest, OfWhatAStateReportsTheReasonForItsModeIsTold) {
  tendril_lcm::state_t state;
  EXPECT_EQ(ReasonForMode(state), Status::kOk);
  state.reported = {323, 304};
  EXPECT_EQ(ReasonForMode(state), Status::kOk);
  state.reported = {323, 310, 304};
  EXPECT_EQ(ReasonForMode(state), Status::kCommandsSilent);
  state.reported = {404, 310};
  EXPECT_EQ(ReasonForMode(state), Status::kTensionOverLimit);
}

TEST_F(GatewayTest, HandleOfNothingReturnsAtOnce) { EXPECT_EQ(gateway.Handle(0), 0); }

TEST_F(GatewayTest, EachKindOfCommandArrivesAsItWasSent) {
  Command tip;
  tip.kind = CommandKind::kTip;
  tip.sequence = 1;
  tip.valid_for_ns = kNsPerS;
  tip.tip_W_m = {0.01, 0.02, 0.03};
  tip.tip_velocity_W_mps = {0.1, 0.2, 0.3};
  Command tension;
  tension.kind = CommandKind::kTension;
  tension.sequence = 2;
  tension.valid_for_ns = kNsPerS;
  tension.tension_N = Eigen::Vector3d(1, 2, 3);
  Command mode;
  mode.kind = CommandKind::kMode;
  mode.sequence = 0xFFFFFFFF;
  mode.sender = SenderOfProcess();
  mode.valid_for_ns = kNsPerS;
  mode.mode = ModeRequest::kClear;
  for (const Command& c : {tip, tension, Bending(), mode}) ASSERT_TRUE(client.Send(c, 0));
  Settle();
  ASSERT_EQ(commands.size(), 4U);
  EXPECT_EQ(commands[0].tip_W_m, tip.tip_W_m);
  EXPECT_EQ(commands[0].tip_velocity_W_mps, tip.tip_velocity_W_mps);
  EXPECT_EQ(commands[1].tension_N, tension.tension_N);
  EXPECT_EQ(commands[2].bending_rad, Bending().bending_rad);
  EXPECT_EQ(commands[2].bending_rate_radps, Bending().bending_rate_radps);
  EXPECT_EQ(commands[2].speed_radps, 0.5);
  EXPECT_EQ(commands[2].valid_for_ns, kNsPerS / 4);
  EXPECT_EQ(commands[3].mode, ModeRequest::kClear);
  EXPECT_EQ(commands[3].sequence, 0xFFFFFFFFU);
  EXPECT_EQ(commands[3].sender, mode.sender);
  EXPECT_EQ(SenderText(mode.sender), "process " + std::to_string(getpid()));
  EXPECT_EQ(SenderText(121), "sender 121");
  EXPECT_GT(SequenceOf(mode), 0) << "a number that grows";
  for (const Command& c : commands) EXPECT_EQ(c.received_ns, clock.Now());
}

// The gate refuses a number that is not above the sender's last one, whichever thread of the process sent it.
TEST_F(GatewayTest, TheNumbersOfAProcessIncreaseInTheOrderOfSending) {
  constexpr int kThreads = 2, kCommands = 500;
  std::vector<std::thread> senders;
  for (int i = 0; i < kThreads; ++i) {
    senders.emplace_back([this] {
      Client own(gateway.lcm(), "TENDRIL");
      Command c = Bending();
      for (int n = 0; n < kCommands; ++n) {
        const std::int64_t number = Publish(own, c, "memq://");
        EXPECT_EQ(number, SequenceOf(c));
      }
    });
  }
  for (std::thread& sender : senders) sender.join();
  Settle();
  ASSERT_EQ(commands.size(), std::size_t{kThreads * kCommands});
  for (std::size_t i = 1; i < commands.size(); ++i) {
    ASSERT_EQ(commands[i].sender, SenderOfProcess());
    ASSERT_GT(static_cast<std::int32_t>(commands[i].sequence - commands[i - 1].sequence), 0)
        << "command " << i;
  }
}

// Wall clocks are corrected, by an hour at times, and those of two computers differ: a command's age counts
// from its arrival, by the monotonic clock.
TEST_F(GatewayTest, ACommandsAgeCountsFromItsArrivalWhateverItsSendersClockSays) {
  for (const std::int64_t utime : {4'900'000L, 5'100'000L, -3'600'000'000L, 3'600'000'000L, 0L}) {
    client.Send(Bending(), utime);
  }
  Settle();
  ASSERT_EQ(commands.size(), 5U);
  for (const Command& c : commands) EXPECT_EQ(c.received_ns, 5 * kNsPerS);
}

// On this machine's clock: stamped when it arrived, not when it was handled.
TEST(GatewayOnThisMachine, ACommandAgesWhileItWaitsToBeHandled) {
  const MonotonicClock clock;
  Gateway gateway(GatewayTest::Parameters(), kShape, clock);
  Client client(gateway.lcm(), "TENDRIL");
  std::vector<Command> commands;
  gateway.OnCommand([&](const Command& c) { commands.push_back(c); });
  const auto hour_us = 3'600'000'000L;
  const std::int64_t now_us = EpochUs();
  const TimeNs sent_ns = clock.Now();
  client.Send(Bending(), now_us - hour_us);
  client.Send(Bending(), now_us + hour_us);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  while (gateway.Handle(0) > 0) {
  }
  ASSERT_EQ(commands.size(), 2U);
  for (const Command& c : commands) {
    EXPECT_GE(c.received_ns, sent_ns - 10 * kNsPerMs);
    EXPECT_LE(c.received_ns, sent_ns + 100 * kNsPerMs);
  }
}

TEST_F(GatewayTest, ImpossibleSizesAndRubbishAreCountedAndReportedOnceASecond) {
  auto* lcm = gateway.lcm();
  std::vector<std::string> complaints;
  gateway.OnComplaint([&](Status status, const std::string& text) {
    EXPECT_EQ(status, Status::kMessageIgnored);
    complaints.push_back(text);
  });
  tendril_lcm::command_tension_t many{};
  many.num_tendons = 17;
  many.tension_base_N.assign(17, 1.0);
  lcm->publish("TENDRIL_COMMAND_TENSION", &many);
  for (int i = 0; i < 10; ++i) lcm->publish("TENDRIL_COMMAND_TIP", "rubbish", 7);
  Settle();
  EXPECT_TRUE(commands.empty());
  EXPECT_EQ(gateway.counters().received, 11U);
  EXPECT_EQ(gateway.counters().undecodable, 11U);
  ASSERT_EQ(events.size(), 1U);
  EXPECT_THAT(events[0].text, HasSubstr("tension_base_N has 17 values, at most 16"));
  clock.Advance(kNsPerS);
  lcm->publish("TENDRIL_COMMAND_TIP", "rubbish", 7);
  Settle();
  ASSERT_EQ(events.size(), 2U);
  EXPECT_THAT(events[1].text, HasSubstr("12 ignored since start"));
  EXPECT_EQ(events[1].status, static_cast<int>(Status::kMessageIgnored));
  ASSERT_EQ(complaints.size(), 2U) << "for the log";
  EXPECT_EQ(complaints[1], events[1].text);
}

// Two daemons on the same channels find each other by these.
TEST_F(GatewayTest, RunRecordsSayWhichDaemonTheyAreFromAndStayYaml) {
  std::vector<RunInfo> heard;
  gateway.OnRun([&](const RunInfo& r) { heard.push_back(r); });
  gateway.PublishRun({"robot: 1\n", "bus: 2\n", "0.1.0", "abc", 42, "host a, process 3"});
  gateway.PublishRun({"robot: 1\n", "bus: 2\n", "0.1.0", "abc", 43});
  tendril_lcm::run_t message{};
  ToMessage({"robot: 1\n", "bus: 2\n", "0.1.0", "abc", 42, "host a, process 3"}, kShape, 0, message);
  EXPECT_EQ(message.daemon_yaml, "# daemon: host a, process 3\nbus: 2\n");
  Settle();
  ASSERT_EQ(heard.size(), 2U);
  EXPECT_EQ(heard[0].daemon, "host a, process 3");
  EXPECT_EQ(heard[0].daemon_yaml, "bus: 2\n");
  EXPECT_EQ(heard[0].start_utime, 42);
  EXPECT_EQ(heard[1].daemon, "");
  EXPECT_EQ(heard[1].daemon_yaml, "bus: 2\n");
}

TEST_F(GatewayTest, TheStateTellsTheFateOfTheLastCommand) {
  CycleRecord record = RandomRecords(kShape, 1).Next();
  record.input.command.kind = CommandKind::kTip;
  record.input.command.sequence = 77;
  record.input.command.sender = 5;
  record.output.mode = Mode::kHold;
  record.output.command_status = Status::kCommandWrongMode;
  gateway.PublishState(record);
  record.input.command = {};
  gateway.PublishState(record);
  // Where more is known it stands until the next command; what a cycle has to say comes by its severity.
  record.input.command.kind = CommandKind::kTip;
  record.output.status = Status::kSlack;
  record.output.reported = {Status::kTargetUnreachable, Status::kSlack, Status::kSlowedByTension};
  gateway.PublishState(record, "because of the weather; wait");
  record.input.command = {};
  gateway.PublishState(record);
  record.input.command.kind = CommandKind::kTip;
  record.output.command_status = Status::kOk;
  record.output.reported = {};
  gateway.PublishState(record);
  Settle();
  ASSERT_EQ(states.size(), 5U);
  for (int i : {2, 3}) {
    EXPECT_EQ(states[i].command_status_text, "because of the weather; wait");
    EXPECT_THAT(states[i].reported, testing::ElementsAre(303, 110, 107));
  }
  EXPECT_EQ(states[4].command_status_text, "ok");
  EXPECT_THAT(states[4].reported, testing::IsEmpty());
  constexpr std::int64_t as_sent = (std::int64_t{5} << 32) + 77;
  EXPECT_EQ(states[0].command_sequence, as_sent);
  EXPECT_EQ(states[0].command_status, 204);
  EXPECT_EQ(states[0].command_status_text, std::string(StatusText(Status::kCommandWrongMode)) + "; " +
                                               std::string(StatusRemedy(Status::kCommandWrongMode)));
  EXPECT_EQ(states[0].mode_text, "hold");
  EXPECT_EQ(states[1].command_sequence, as_sent);
  EXPECT_EQ(gateway.counters().published, 5U);
}

TEST(GatewayRates, EveryNthStateAndEachWithNews) {
  SimulatedClock clock;
  LcmParameters parameters{"memq://", "X", 10, 0};
  Gateway gateway(parameters, kShape, clock);
  CycleRecord record;
  record.output.mode = Mode::kRunning;
  for (int i = 0; i < 100; ++i) {
    record.input.cycle = static_cast<std::uint64_t>(i);
    record.input.command.kind = i == 55 ? CommandKind::kTip : CommandKind::kNone;
    if (i == 77) record.output.mode = Mode::kFault;
    gateway.PublishState(record);
    gateway.PublishCycle(record);
  }
  EXPECT_EQ(gateway.counters().published, 12U);
}

std::string WhyNot(const LcmParameters& parameters) {
  try {
    const SimulatedClock clock;
    Gateway gateway(parameters, kShape, clock);
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "opened";
}

TEST(GatewayOpening, ErrorsNameTheAddressAndTheRemedy) {
  EXPECT_THAT(WhyNot({"udpm://10.0.0.1:7667", "TENDRIL", 1, 1}),
              AllOf(HasSubstr("'udpm://10.0.0.1:7667' cannot be opened"), HasSubstr("a multicast address")));
  EXPECT_THAT(WhyNot({"nothing://", "TENDRIL", 1, 1}), HasSubstr("'nothing://' cannot be opened"));
  EXPECT_THAT(WhyNot({"udpm://239.255.76.67:7667?tll=1", "TENDRIL", 1, 1}),
              HasSubstr("accepted: udpm://ADDRESS:PORT?ttl=N"));
  EXPECT_THAT(WhyNot({"memq://", "A.*", 1, 1}), HasSubstr("channel prefix 'A.*'"));
}

}  // namespace
}  // namespace tendril::io
