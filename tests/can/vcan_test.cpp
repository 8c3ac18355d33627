// SocketCanPort on a real vcan0 (label "vcan"): frames, stamps, drop counter, error frames, waiting.
// Knows only the CAN room; skips where there is no vcan0.
#include <gtest/gtest.h>
#include <net/if.h>

#include <cerrno>
#include <cstdlib>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "tendril/can/socketcan_port.h"

namespace tendril::can {
namespace {

class VcanTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (if_nametoindex("vcan0") == 0) GTEST_SKIP() << "no vcan0 here: run under tools/vcan-run";
    a_ = std::make_unique<SocketCanPort>("vcan0");
    b_ = std::make_unique<SocketCanPort>("vcan0");
  }

  static CanFrame Frame(std::uint32_t id, std::uint8_t size) {
    CanFrame f;
    f.id = id;
    f.size = size;
    for (std::uint8_t i = 0; i < size; ++i) f.data[i] = static_cast<std::uint8_t>(i + 1);
    return f;
  }

  MonotonicClock clock_;
  std::unique_ptr<SocketCanPort> a_, b_;
};

TEST_F(VcanTest, FramesArriveWholeInOrderAndStampedWithTheMonotonicClock) {
  const TimeNs before_ns = clock_.Now();
  for (std::uint32_t i = 0; i < 200; ++i) ASSERT_TRUE(a_->Send(Frame(i, static_cast<std::uint8_t>(i % 9))));
  const TimeNs after_ns = clock_.Now();
  std::vector<StampedFrame> got(256);
  ASSERT_EQ(b_->Receive(got), 200);
  for (std::uint32_t i = 0; i < 200; ++i) {
    ASSERT_EQ(got[i].frame.id, i);
    ASSERT_EQ(got[i].frame.size, i % 9);
    ASSERT_EQ(got[i].frame.data, Frame(i, static_cast<std::uint8_t>(i % 9)).data);
    ASSERT_GE(got[i].time_ns, before_ns - kNsPerMs);
    ASSERT_LE(got[i].time_ns, after_ns + kNsPerMs);
  }
  EXPECT_EQ(a_->counters().sent, 200u);
  EXPECT_EQ(b_->counters().received, 200u);
  EXPECT_EQ(a_->counters().bits, b_->counters().bits);
  EXPECT_EQ(a_->Receive(got), 0) << "a port must not hear itself";
}

TEST_F(VcanTest, ManyFramesInOneCallArriveAsIfSentOneByOne) {
  std::vector<CanFrame> frames;
  for (std::uint32_t i = 0; i < 150; ++i) frames.push_back(Frame(i, static_cast<std::uint8_t>(i % 9)));
  frames[70].remote = true;
  const TimeNs before_ns = clock_.Now();
  ASSERT_EQ(a_->SendAll(frames), 150);
  const TimeNs after_ns = clock_.Now();
  std::vector<StampedFrame> got(256);
  ASSERT_EQ(b_->Receive(got), 150);
  for (std::uint32_t i = 0; i < 150; ++i) {
    ASSERT_EQ(got[i].frame.id, i);
    ASSERT_EQ(got[i].frame.size, i % 9);
    ASSERT_EQ(got[i].frame.remote, i == 70);
    ASSERT_GE(got[i].time_ns, before_ns - kNsPerMs);
    ASSERT_LE(got[i].time_ns, after_ns + kNsPerMs);
  }
  EXPECT_EQ(a_->counters().sent, 150u);
  EXPECT_EQ(a_->counters().bits, b_->counters().bits);
  EXPECT_EQ(a_->SendAll({}), 0);
}

// The difference of the clocks is read once in a while only: stamps must be right within that time and after
// it.
TEST_F(VcanTest, StampsAreTheTimeOfArrivalHoweverLateTheyAreRead) {
  std::array<StampedFrame, 4> got;
  for (const int wait_ms : {0, 0, 1, 3, 30, 120, 0, 1}) {
    const TimeNs before_ns = clock_.Now();
    ASSERT_TRUE(a_->Send(Frame(1, 1)));
    const TimeNs after_ns = clock_.Now();
    std::this_thread::sleep_for(std::chrono::milliseconds(wait_ms));
    ASSERT_EQ(b_->Receive(got), 1);
    EXPECT_GE(got[0].time_ns, before_ns - kNsPerMs / 2) << wait_ms;
    EXPECT_LE(got[0].time_ns, after_ns + kNsPerMs / 2) << wait_ms;
  }
}

TEST_F(VcanTest, RemoteFramesKeepTheirFlag) {
  CanFrame remote = Frame(0x701, 0);
  remote.remote = true;
  a_->Send(remote);
  std::array<StampedFrame, 4> got;
  ASSERT_EQ(b_->Receive(got), 1);
  EXPECT_TRUE(got[0].frame.remote);
}

TEST_F(VcanTest, WhatASmallBufferLosesIsCounted) {
  SocketCanPort small("vcan0", {.receive_buffer_bytes = 4096, .error_frames = true});
  std::vector<StampedFrame> got(4096);
  for (int i = 0; i < 2000; ++i) a_->Send(Frame(1, 8));
  const int kept = small.Receive(got);
  ASSERT_LT(kept, 2000);
  a_->Send(Frame(2, 8));  // the kernel tells of drops with the next frame
  EXPECT_EQ(small.Receive(got), 1);
  EXPECT_EQ(small.counters().receive_dropped, static_cast<std::uint64_t>(2000 - kept));
  b_->Receive(got);
  EXPECT_EQ(b_->counters().receive_dropped, 0u) << "the default buffer holds 2000 frames";
}

TEST_F(VcanTest, BusOffTakesThePortDownUntilRestarted) {
  CanFrame error;
  error.error = true;
  error.size = 8;
  error.id = kErrorBusOff;
  std::array<StampedFrame, 4> got;
  ASSERT_TRUE(a_->Send(error));
  ASSERT_EQ(b_->Receive(got), 1);
  EXPECT_TRUE(got[0].frame.error);
  EXPECT_FALSE(b_->up());
  EXPECT_EQ(b_->counters().bus_off, 1u);
  a_->Send(Frame(5, 1));
  b_->Receive(got);
  EXPECT_FALSE(b_->up()) << "only a restart ends bus-off";
  error.id = kErrorRestarted;
  a_->Send(error);
  b_->Receive(got);
  EXPECT_TRUE(b_->up());
  EXPECT_EQ(b_->counters().received, 1u);
}

TEST_F(VcanTest, BusOffWhoseRestartNobodyTellsIsOverWhenTheInterfaceRuns) {
  CanFrame error;
  error.error = true;
  error.size = 8;
  error.id = kErrorBusOff;
  std::array<StampedFrame, 4> got;
  ASSERT_TRUE(a_->Send(error));
  ASSERT_EQ(b_->Receive(got), 1);
  EXPECT_TRUE(b_->bus_off());
  b_->Restart();
  EXPECT_FALSE(b_->bus_off());
  EXPECT_TRUE(b_->up());
  b_->Restart();  // nothing to do, nothing done
  EXPECT_TRUE(b_->Send(Frame(5, 1)));
  EXPECT_EQ(a_->Receive(got), 1);
}

TEST_F(VcanTest, WaitEndsAtTheFrameOrAtTheDeadline) {
  const TimeNs start_ns = clock_.Now();
  EXPECT_FALSE(b_->WaitUntil(start_ns + 20 * kNsPerMs));
  EXPECT_GE(clock_.Now() - start_ns, 20 * kNsPerMs);
  std::thread sender([this] {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    a_->Send(Frame(1, 1));
  });
  EXPECT_TRUE(b_->WaitUntil(clock_.Now() + 5 * kNsPerS));
  sender.join();
  EXPECT_LT(clock_.Now() - start_ns, 4 * kNsPerS);
  EXPECT_TRUE(b_->WaitUntil(0)) << "a waiting frame is there whatever the deadline";
}

// An interface of its own, because taking vcan0 down would disturb other tests.
class LinkTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (if_nametoindex("vcan0") == 0) GTEST_SKIP() << "no vcan0 here: run under tools/vcan-run";
    if (!Ip("link add tdlink type vcan") || !Ip("link set tdlink up")) {
      GTEST_SKIP() << "may not create an interface here";
    }
  }
  void TearDown() override { Ip("link del tdlink"); }

  static bool Ip(const std::string& arguments) {
    return std::system(("ip " + arguments + " 2>/dev/null").c_str()) == 0;
  }
  /// Polls as a loop would, until the port's state is the wanted one.
  static bool Becomes(SocketCanPort& port, bool up) {
    std::array<StampedFrame, 4> got;
    for (int i = 0; i < 100 && port.up() != up; ++i) {
      port.Receive(got);
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return port.up() == up;
  }
};

TEST_F(LinkTest, ADownInterfaceIsRefusedAndNamed) {
  ASSERT_TRUE(Ip("link set tdlink down"));
  try {
    SocketCanPort port("tdlink");
    FAIL() << "opened an interface that is down";
  } catch (const std::system_error& e) {
    EXPECT_EQ(e.code().value(), ENETDOWN);
    EXPECT_NE(std::string(e.what()).find("'tdlink' is down; bring it up: ip link set tdlink up"),
              std::string::npos);
  }
}

TEST_F(LinkTest, ThePortComesBackWithTheInterface) {
  SocketCanPort a("tdlink"), b("tdlink");
  CanFrame frame;
  frame.id = 0x123;
  std::array<StampedFrame, 4> got;
  ASSERT_TRUE(Ip("link set tdlink down"));
  EXPECT_TRUE(Becomes(b, false));
  EXPECT_FALSE(a.Send(frame));
  EXPECT_FALSE(a.up());
  EXPECT_EQ(a.counters().send_refused, 1u);
  EXPECT_EQ(a.SendAll(std::array<CanFrame, 3>{frame, frame, frame}), 0);
  EXPECT_EQ(a.counters().send_refused, 4u);
  ASSERT_TRUE(Ip("link set tdlink up"));
  EXPECT_TRUE(Becomes(a, true));
  EXPECT_TRUE(Becomes(b, true));
  EXPECT_TRUE(a.Send(frame));
  EXPECT_EQ(b.Receive(got), 1);

  ASSERT_TRUE(Ip("link del tdlink"));  // the adapter is pulled out and plugged in again
  EXPECT_TRUE(Becomes(a, false));
  EXPECT_TRUE(Becomes(b, false));
  ASSERT_TRUE(Ip("link add tdlink type vcan") && Ip("link set tdlink up"));
  EXPECT_TRUE(Becomes(a, true));
  EXPECT_TRUE(Becomes(b, true));
  EXPECT_TRUE(a.Send(frame));
  EXPECT_EQ(b.Receive(got), 1);
}

}  // namespace
}  // namespace tendril::can
