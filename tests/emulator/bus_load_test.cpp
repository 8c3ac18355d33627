// The load that a third station counts on a real vcan0 (label "vcan"), beside the figure of the budget.
// Frames go through the kernel, time is simulated: a cycle is a cycle whatever this machine does meanwhile.
// Skips where there is no vcan0.
#include <gtest/gtest.h>
#include <net/if.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "support/test_rack.h"
#include "tendril/can/socketcan_port.h"
#include "tendril/core/clock.h"

namespace tendril::emulator {
namespace {

// Worst case of an 11-bit data frame with 0 to 8 bytes, from the frame's layout: 8 n + 47 bits and a stuff
// bit for each four of the 34 + 8 n - 1 that are stuffed.
constexpr std::array<int, 9> kBits = {55, 65, 75, 85, 95, 105, 115, 125, 135};

class BusLoad : public ::testing::Test {
 protected:
  void SetUp() override {
    if (if_nametoindex("vcan0") == 0) GTEST_SKIP() << "no vcan0 here: run under tools/vcan-run";
    for (auto* port : {&master_port_, &rack_port_, &listener_}) port->emplace("vcan0");
    rack_ = std::make_unique<DriveRack>(TestRack(kDrives), *rack_port_);
    master_ = std::make_unique<canopen::Master>(canopen::TestBus(kDrives), canopen::TestDrives(kDrives),
                                                *master_port_);
    master_->Start(clock_.Now());
  }

  // After many frames the kernel leaves them to a thread of its own, which this one, never waiting, would
  // keep out.
  static void LetTheKernelDeliver() { std::this_thread::sleep_for(std::chrono::microseconds(1)); }

  /// One cycle; returns the bits that were on the wire.
  std::int64_t Step() {
    clock_.Advance(kNsPerMs);
    master_->BeginCycle(clock_.Now());
    LetTheKernelDeliver();
    rack_->Poll(clock_.Now());
    LetTheKernelDeliver();
    master_->Poll(clock_.Now());
    master_->EndCycle(clock_.Now(), request_, torques_);
    LetTheKernelDeliver();
    rack_->Poll(clock_.Now());
    LetTheKernelDeliver();
    std::array<can::StampedFrame, 256> got;
    std::int64_t bits = 0;
    const int n = listener_->Receive(got);
    for (int i = 0; i < n; ++i) {
      const can::CanFrame& frame = got[static_cast<std::size_t>(i)].frame;
      bits += kBits[frame.size];
      sdo_bits_ += (frame.id >= 0x580 && frame.id < 0x680) ? kBits[frame.size] : 0;
    }
    return bits;
  }
  /// [bit/s] over so many cycles of 1 ms.
  double Load(int cycles) {
    std::int64_t bits = 0;
    for (int i = 0; i < cycles; ++i) {
      if (alternating_) torques_.assign(kDrives, static_cast<std::int16_t>(i / 10 % 2 ? 0 : 3000));
      bits += Step();
    }
    EXPECT_EQ(listener_->counters().receive_dropped, 0u);
    return static_cast<double>(bits) * 1000 / cycles;
  }
  bool All(DriveState state) const {
    for (int i = 0; i < kDrives; ++i) {
      if (master_->feedback(i).state != state) return false;
    }
    return true;
  }
  bool StepUntil(DriveState state) {
    for (int i = 0; i < 4000 && !All(state); ++i) Step();
    return All(state);
  }

  SimulatedClock clock_{kNsPerS};
  std::optional<can::SocketCanPort> master_port_, rack_port_, listener_;
  std::unique_ptr<DriveRack> rack_;
  std::unique_ptr<canopen::Master> master_;
  DriveRequest request_ = DriveRequest::kDisable;
  std::vector<std::int16_t> torques_ = std::vector<std::int16_t>(kDrives, 100);
  bool alternating_ = false;
  std::int64_t sdo_bits_ = 0;
};

// With every drive's statusword changing as often as its inhibit time lets it be sent, the drives send all
// that the budget counts, SDO excepted. Over 2 s the count can be off by one heartbeat of each of the four
// stations and one statusword of each drive, 485 bits of a million and a half; 0.1 % is three times that.
TEST_F(BusLoad, CountedOnTheWireIsTheBudgetsFigure) {
  const canopen::BusBudget budget =
      canopen::ComputeBusBudget(canopen::TestBus(kDrives), canopen::TestDrives(kDrives));
  ASSERT_TRUE(StepUntil(DriveState::kReady));
  request_ = DriveRequest::kEnable;
  ASSERT_TRUE(StepUntil(DriveState::kEnabled));
  for (int i = 0; i < 500; ++i) Step();

  sdo_bits_ = 0;
  const double calm = Load(2000);
  EXPECT_NEAR(calm, budget.cyclic_bits_per_s + 4 * kBits[1] * 10, 0.001 * calm)
      << "SYNC, PDOs and heartbeats";
  EXPECT_EQ(sdo_bits_, 0) << "no SDO while nothing is wrong";

  alternating_ = true;  // above the current limit and back each 10 ms: a bit of the statusword changes
  const double lively = Load(2000);
  EXPECT_EQ(sdo_bits_, 0);
  const double counted = lively + budget.sdo_bits_per_s;
  const double figure = budget.load * canopen::TestBus(kDrives).bitrate_bps;
  std::printf(
      "counted %.0f bit/s calm, %.0f bit/s lively; with room for SDO %.0f, budget %.0f (%.2f %% apart)\n",
      calm, lively, counted, figure, 100 * (counted / figure - 1));
  EXPECT_NEAR(counted, figure, 0.001 * figure) << "neither more than the budget, nor a budget for nothing";
  EXPECT_LE(lively, figure) << "the budget is an upper bound";
}

// What boots uses what the others leave of the 80 %, never more: over any 20 ms, in which one more exchange
// of SDO (270 bits) than the share may fall, hence the 2 % of 16000 bits.
TEST_F(BusLoad, SdoUsesWhatIsLeftAndNoMore) {
  std::deque<std::int64_t> window;
  std::int64_t in_window = 0, most = 0;
  const auto step = [&] {
    window.push_back(Step());
    in_window += window.back();
    if (window.size() > 20) {
      in_window -= window.front();
      window.pop_front();
    }
    most = std::max(most, in_window);
  };
  for (int i = 0; i < 1000; ++i) step();
  ASSERT_TRUE(All(DriveState::kReady));
  const std::int64_t most_at_start = most;
  EXPECT_LE(most_at_start, 16'000 * 1.02);
  EXPECT_GE(most_at_start, 16'000 * 0.9) << "a boot makes use of it";
  most = 0;
  for (int round = 0; round < 5; ++round) {  // one boots again and again beside the others' cycle
    rack_->PowerCycle(0);
    for (int i = 0; i < 20; ++i) step();
    master_->ClearFaults(clock_.Now());
    for (int i = 0; i < 500; ++i) step();
  }
  std::printf("most in 20 ms: %.1f %% of the bus while all boot, %.1f %% while one boots beside the cycle\n",
              most_at_start / 200.0, static_cast<double>(most) / 200.0);
  EXPECT_LE(most, 16'000 * 1.02);
}

}  // namespace
}  // namespace tendril::emulator
