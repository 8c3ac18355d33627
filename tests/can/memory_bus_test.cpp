// The memory bus behaves like a bus: order, stamps, counters, faults.
// Knows only the CAN room.
#include "tendril/can/memory_bus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tendril::can {
namespace {

CanFrame Frame(std::uint32_t id, std::initializer_list<std::uint8_t> bytes) {
  CanFrame f;
  f.id = id;
  f.size = static_cast<std::uint8_t>(bytes.size());
  std::copy(bytes.begin(), bytes.end(), f.data.begin());
  return f;
}

// Bits written out by hand: 44 + 8n frame bits with 3 of intermission, and a stuff bit each 4 bits after the
// first of the 34 + 8n bits that are stuffed.
TEST(WorstCaseBits, AreThoseOfAClassicFrame) {
  EXPECT_EQ(WorstCaseBits(0), 55);
  EXPECT_EQ(WorstCaseBits(2), 75);
  EXPECT_EQ(WorstCaseBits(4), 95);
  EXPECT_EQ(WorstCaseBits(6), 115);
  EXPECT_EQ(WorstCaseBits(8), 135);
  CanFrame remote = Frame(0x701, {});
  remote.remote = true;
  remote.size = 1;
  EXPECT_EQ(WorstCaseBits(remote), 55);
}

class MemoryBusTest : public ::testing::Test {
 protected:
  std::vector<StampedFrame> Drain(CanPort& port) {
    std::vector<StampedFrame> out(16);
    out.resize(static_cast<std::size_t>(port.Receive(out)));
    return out;
  }

  SimulatedClock clock_;
  MemoryBus bus_{clock_};
  CanPort& a_ = bus_.AddPort();
  CanPort& b_ = bus_.AddPort();
  CanPort& c_ = bus_.AddPort();
};

TEST_F(MemoryBusTest, EveryOtherPortSeesEveryFrameInOrderWithItsTime) {
  clock_.Advance(1000);
  ASSERT_TRUE(a_.Send(Frame(0x80, {})));
  clock_.Advance(500);
  ASSERT_TRUE(b_.Send(Frame(0x181, {1, 2})));

  const auto at_c = Drain(c_);
  ASSERT_EQ(at_c.size(), 2u);
  EXPECT_EQ(at_c[0].frame.id, 0x80u);
  EXPECT_EQ(at_c[0].time_ns, 1000);
  EXPECT_EQ(at_c[1].frame.id, 0x181u);
  EXPECT_EQ(at_c[1].frame.size, 2);
  EXPECT_EQ(at_c[1].frame.data[1], 2);
  EXPECT_EQ(at_c[1].time_ns, 1500);

  const auto at_a = Drain(a_);
  ASSERT_EQ(at_a.size(), 1u) << "a port must not hear itself";
  EXPECT_EQ(at_a[0].frame.id, 0x181u);
}

TEST_F(MemoryBusTest, ReceiveTakesNoMoreThanAskedAndKeepsTheRest) {
  for (std::uint32_t i = 0; i < 5; ++i) a_.Send(Frame(i, {}));
  std::array<StampedFrame, 2> two;
  EXPECT_TRUE(b_.WaitUntil(0));
  EXPECT_EQ(b_.Receive(two), 2);
  EXPECT_EQ(two[1].frame.id, 1u);
  const auto rest = Drain(b_);
  ASSERT_EQ(rest.size(), 3u);
  EXPECT_EQ(rest.back().frame.id, 4u);
  EXPECT_FALSE(b_.WaitUntil(1'000'000'000)) << "nothing waits, and simulated time cannot be waited for";
}

TEST_F(MemoryBusTest, CountsEachFrameAndItsBitsOnce) {
  a_.Send(Frame(0x80, {}));
  b_.Send(Frame(0x181, {1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(bus_.totals().sent, 2u);
  EXPECT_EQ(bus_.totals().bits, 55u + 135u);
  EXPECT_EQ(bus_.totals().received, 4u);
  EXPECT_EQ(a_.counters().sent, 1u);
  EXPECT_EQ(a_.counters().received, 1u);
  for (const CanPort* port : {&a_, &b_, &c_}) EXPECT_EQ(port->counters().bits, 190u);
}

TEST_F(MemoryBusTest, AFullReaderLosesFramesAndSaysSo) {
  for (int i = 0; i < 8192 + 7; ++i) a_.Send(Frame(1, {}));
  EXPECT_EQ(b_.counters().received, 8192u);
  EXPECT_EQ(b_.counters().receive_dropped, 7u);
  Drain(b_);
  a_.Send(Frame(2, {}));
  EXPECT_EQ(b_.counters().receive_dropped, 7u);
}

TEST_F(MemoryBusTest, TheRingKeepsOrderOverManyTurns) {
  std::uint32_t sent = 0, expected = 0;
  std::array<StampedFrame, 64> some;
  for (int turn = 0; turn < 3000; ++turn) {
    for (int i = 0; i < 1 + turn % 13; ++i) a_.Send(Frame(sent++ % 0x800, {}));
    const int n = b_.Receive(some);
    for (int i = 0; i < n; ++i) {
      ASSERT_EQ(some[static_cast<std::size_t>(i)].frame.id, expected % 0x800);
      ++expected;
    }
    Drain(c_);
  }
  EXPECT_EQ(sent, expected);
}

TEST_F(MemoryBusTest, TheFilterSeesDropsAndChangesFrames) {
  bus_.SetFilter([](CanFrame& f) {
    if (f.id == 0x80) return false;
    f.data[0] ^= 0xFF;
    return true;
  });
  EXPECT_TRUE(a_.Send(Frame(0x80, {})));
  EXPECT_TRUE(a_.Send(Frame(0x201, {0x0F})));
  const auto got = Drain(b_);
  ASSERT_EQ(got.size(), 1u);
  EXPECT_EQ(got[0].frame.data[0], 0xF0);
  EXPECT_EQ(bus_.totals().sent, 2u) << "a frame lost on the wire was still on the wire";
}

TEST_F(MemoryBusTest, BusOffIsToldOnceAndStopsEverything) {
  bus_.SetBusOff(true);
  bus_.SetBusOff(true);
  EXPECT_FALSE(a_.up());
  EXPECT_FALSE(a_.Send(Frame(0x80, {})));
  EXPECT_EQ(a_.counters().send_refused, 1u);
  auto got = Drain(b_);
  ASSERT_EQ(got.size(), 1u);
  EXPECT_TRUE(got[0].frame.error);
  EXPECT_EQ(got[0].frame.id, kErrorBusOff);
  EXPECT_EQ(b_.counters().bus_off, 1u);

  bus_.SetBusOff(false);
  EXPECT_TRUE(b_.up());
  EXPECT_TRUE(a_.Send(Frame(0x80, {})));
  got = Drain(b_);
  ASSERT_EQ(got.size(), 2u);
  EXPECT_EQ(got[0].frame.id, kErrorRestarted);
  EXPECT_EQ(got[1].frame.id, 0x80u);
}

TEST_F(MemoryBusTest, AnErrorFrameOfAPortActsOnTheOthersAsOnAVirtualInterface) {
  CanFrame error;
  error.error = true;
  error.size = 8;
  error.id = kErrorBusOff;
  EXPECT_TRUE(a_.Send(error));
  EXPECT_TRUE(a_.up());
  EXPECT_FALSE(b_.up());
  EXPECT_FALSE(c_.up());
  EXPECT_EQ(b_.counters().bus_off, 1u);
  EXPECT_EQ(bus_.totals().bits, 0u) << "no frame was on the wire";
  error.id = kErrorRestarted;
  EXPECT_TRUE(a_.Send(error));
  EXPECT_TRUE(b_.up());
  EXPECT_EQ(Drain(b_).size(), 2u);
}

}  // namespace
}  // namespace tendril::can
