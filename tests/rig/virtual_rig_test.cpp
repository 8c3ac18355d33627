// Drives and plant joined, seen from the bus: what a master reads is what the plant does, and its torque
// moves it.
#include "tendril/rig/virtual_rig.h"

#include <gtest/gtest.h>

#include <array>
#include <numbers>

#include "sim/motions.h"
#include "tendril/can/memory_bus.h"
#include "tendril/core/clock.h"

namespace tendril::rig {
namespace {

constexpr int kTorqueMode = 10;

/// A master of the plainest kind: expedited SDO downloads, RPDO1 = controlword, target torque, TPDO1 =
/// position, actual torque, load cell, all on SYNC.
class Bench {
 public:
  explicit Bench(const RobotParameters& robot)
      : bus_(clock_), rig_(robot, bus_.AddPort(), {.sensor_noise = false}), port_(bus_.AddPort()) {
    rig_.Poll(clock_.Now());  // the drives boot; they are deaf before
    Read();
  }

  void Cycle(std::span<const std::uint16_t> controlword, std::span<const std::int16_t> permille) {
    clock_.Advance(kNsPerMs);
    Send(0x80, {});
    for (std::size_t i = 0; i < permille.size(); ++i) {
      const auto torque = static_cast<std::uint16_t>(permille[i]);
      Send(0x201 + static_cast<std::uint32_t>(i),
           {Low(controlword[i]), High(controlword[i]), Low(torque), High(torque)});
    }
    rig_.Poll(clock_.Now());
    Read();
  }
  void Configure(int node) {
    Send(0, {0x80, static_cast<std::uint8_t>(node)});
    Write(node, 0x6060, 0, 1, kTorqueMode);
    Map(node, 0x1400, 0x1600, 0x200, {0x60400010, 0x60710010});
    Map(node, 0x1800, 0x1A00, 0x180, {0x60640020, 0x60770010, 0x31600110});
    Send(0, {0x01, static_cast<std::uint8_t>(node)});
    rig_.Poll(clock_.Now());
    Read();
  }
  rig::VirtualRig& rig() { return rig_; }
  int refused() const { return refused_; }

  struct Feedback {
    int position = 0, permille = 0, millivolts = 0, count = 0;
  };
  Feedback feedback[3];

 private:
  static std::uint8_t Low(std::uint32_t v) { return static_cast<std::uint8_t>(v & 0xFF); }
  static std::uint8_t High(std::uint32_t v) { return static_cast<std::uint8_t>(v >> 8 & 0xFF); }

  void Send(std::uint32_t id, std::initializer_list<std::uint8_t> bytes) {
    can::CanFrame frame;
    frame.id = id;
    frame.size = static_cast<std::uint8_t>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), frame.data.begin());
    port_.Send(frame);
  }
  void Write(int node, std::uint32_t index, std::uint8_t sub, int size, std::uint32_t value) {
    Send(0x600 + static_cast<std::uint32_t>(node),
         {static_cast<std::uint8_t>(0x23 | (4 - size) << 2), Low(index), High(index), sub, Low(value),
          High(value), Low(value >> 16), Low(value >> 24)});
    rig_.Poll(clock_.Now());
    Read();
  }
  void Map(int node, std::uint32_t communication, std::uint32_t mapping, std::uint32_t cob,
           std::initializer_list<std::uint32_t> entries) {
    const std::uint32_t id = 0x40000000u + cob + static_cast<std::uint32_t>(node);
    Write(node, communication, 1, 4, 0x80000000u | id);
    Write(node, communication, 2, 1, 1);
    Write(node, mapping, 0, 1, 0);
    std::uint8_t sub = 0;
    for (const std::uint32_t entry : entries) Write(node, mapping, ++sub, 4, entry);
    Write(node, mapping, 0, 1, sub);
    Write(node, communication, 1, 4, id);
  }
  void Read() {
    std::array<can::StampedFrame, 64> frames;
    for (int n = port_.Receive(frames); n > 0; n = port_.Receive(frames)) {
      for (int i = 0; i < n; ++i) {
        const auto& f = frames[static_cast<std::size_t>(i)].frame;
        if (f.id >= 0x181 && f.id <= 0x183 && f.size == 8) {
          auto& to = feedback[f.id - 0x181];
          to.position = static_cast<std::int32_t>(f.data[0] | f.data[1] << 8 | f.data[2] << 16 |
                                                  static_cast<std::uint32_t>(f.data[3]) << 24);
          to.permille = static_cast<std::int16_t>(f.data[4] | f.data[5] << 8);
          to.millivolts = static_cast<std::int16_t>(f.data[6] | f.data[7] << 8);
          ++to.count;
        } else if (f.id > 0x580 && f.id < 0x600 && f.data[0] == 0x80) {
          ++refused_;
        }
      }
    }
  }

  SimulatedClock clock_;
  can::MemoryBus bus_;
  rig::VirtualRig rig_;
  can::CanPort& port_;
  int refused_ = 0;
};

class VirtualRigTest : public testing::Test {
 protected:
  void Cycles(int count, std::uint16_t controlword, std::array<std::int16_t, 3> permille) {
    const std::array<std::uint16_t, 3> words{controlword, controlword, controlword};
    for (int i = 0; i < count; ++i) bench.Cycle(words, permille);
  }
  void Enable() {
    for (int node = 1; node <= 3; ++node) bench.Configure(node);
    ASSERT_EQ(bench.refused(), 0);
    Cycles(3, 0x06, {});
    Cycles(3, 0x07, {});
    Cycles(3, 0x0F, {});
    for (int j = 0; j < 3; ++j) ASSERT_TRUE(bench.rig().drives().enabled(j));
  }
  Bench bench{test::Rig()};
};

TEST_F(VirtualRigTest, BrakeHoldsThePretensionUntilADriveIsEnabled) {
  for (int node = 1; node <= 3; ++node) bench.Configure(node);
  Cycles(500, 0, {});
  for (int j = 0; j < 3; ++j) {
    EXPECT_FALSE(bench.rig().drives().enabled(j));
    EXPECT_NEAR(bench.rig().plant().tendon()[static_cast<std::size_t>(j)].tension_motor_N, 0.3, 1e-4);
    EXPECT_EQ(bench.feedback[j].millivolts, 60);
    EXPECT_EQ(bench.feedback[j].position, 0);
  }
  EXPECT_EQ(bench.rig().plant().time_ns(), 500 * kNsPerMs);  // its time 0 is the first Poll
}

TEST_F(VirtualRigTest, DrivesShowWhatThePlantDoes) {
  Enable();
  Cycles(300, 0x0F, {200, 40, 40});
  for (std::size_t j = 0; j < 3; ++j) {
    const auto& truth = bench.rig().plant().tendon()[j];
    EXPECT_NEAR(bench.feedback[j].millivolts, 200 * truth.tension_motor_N, 0.51);
    EXPECT_NEAR(bench.feedback[j].position, truth.motor_angle_rad * 2048 / (2 * std::numbers::pi), 0.51);
    EXPECT_NEAR(bench.feedback[j].permille, truth.motor_torque_Nm / 7.056e-6, 0.51);
  }
  EXPECT_GT(bench.feedback[0].position, 100);
  EXPECT_GT(bench.feedback[0].millivolts, 200);
}

TEST_F(VirtualRigTest, TorqueActsAtTheSyncAfterTheCycleInWhichItWasSent) {
  Enable();
  Cycles(200, 0x0F, {30, 30, 30});
  const auto torque = [&] { return bench.rig().plant().tendon()[0].motor_torque_Nm / 7.056e-6; };
  Cycles(1, 0x0F, {230, 30, 30});  // sent in this cycle, after its SYNC
  EXPECT_NEAR(torque(), 30, 0.01);
  Cycles(1, 0x0F, {230, 30, 30});  // in force from this SYNC on
  EXPECT_NEAR(torque(), 30, 0.01);
  Cycles(1, 0x0F, {230, 30, 30});  // 1 ms later: two lags
  EXPECT_NEAR(torque(), 230 - 200 * std::exp(-2), 0.05);
}

TEST_F(VirtualRigTest, DisabledAgainItHasNoTorqueAndNoBrake) {
  Enable();
  Cycles(300, 0x0F, {200, 40, 40});
  Cycles(300, 0x00, {200, 40, 40});
  for (const auto& t : bench.rig().plant().tendon()) EXPECT_NEAR(t.motor_torque_Nm, 0, 1e-9);
  EXPECT_LT(bench.rig().plant().tendon()[0].tension_motor_N, 1);
}

}  // namespace
}  // namespace tendril::rig
