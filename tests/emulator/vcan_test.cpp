// The rack on a real vcan0 (label "vcan"): boot-up, SDO and torque at SYNC through the kernel's SocketCAN.
// Speaks bare frames; skips where there is no vcan0.
#include <gtest/gtest.h>
#include <net/if.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "tendril/can/socketcan_port.h"
#include "tendril/emulator/drive_rack.h"

namespace tendril::emulator {
namespace {

using Bytes = std::vector<std::uint8_t>;

class RackOnVcan : public ::testing::Test {
 protected:
  void SetUp() override {
    if (if_nametoindex("vcan0") == 0) GTEST_SKIP() << "no vcan0 here: run under tools/vcan-run";
    master_.emplace("vcan0");
    drives_.emplace("vcan0");
    EmulatedDriveParameters drive;
    drive.node_id = 9;
    drive.nominal_current_mA = 360;
    drive.torque_constant_uNmpA = 19600;
    rack_ = std::make_unique<DriveRack>(std::span(&drive, 1), *drives_);
  }

  void Send(std::uint32_t id, const Bytes& data) {
    can::CanFrame f;
    f.id = id;
    f.size = static_cast<std::uint8_t>(data.size());
    std::copy(data.begin(), data.end(), f.data.begin());
    ASSERT_TRUE(master_->Send(f));
  }

  /// Next frame with this identifier; empty after a second without one.
  Bytes Next(std::uint32_t id) {
    const TimeNs end_ns = clock_.Now() + kNsPerS;
    while (clock_.Now() < end_ns) {
      rack_->Poll(clock_.Now());
      std::array<can::StampedFrame, 1> got;
      if (!master_->WaitUntil(clock_.Now() + kNsPerMs) || master_->Receive(got) == 0) continue;
      if (got[0].frame.id == id)
        return {got[0].frame.data.begin(), got[0].frame.data.begin() + got[0].frame.size};
    }
    return {};
  }

  void Write(const Bytes& request) {
    Send(0x609, request);
    const Bytes answer = Next(0x589);
    ASSERT_EQ(answer.size(), 8u);
    ASSERT_EQ(answer[0], 0x60);
  }

  MonotonicClock clock_;
  std::optional<can::SocketCanPort> master_, drives_;
  std::unique_ptr<DriveRack> rack_;
};

TEST_F(RackOnVcan, BootsAnswersAndDrives) {
  EXPECT_EQ(Next(0x709), (Bytes{0x00}));
  Send(0x609, {0x40, 0x18, 0x10, 0x01, 0, 0, 0, 0});
  EXPECT_EQ(Next(0x589), (Bytes{0x43, 0x18, 0x10, 0x01, 0xFB, 0, 0, 0}));

  Write({0x23, 0x00, 0x14, 0x01, 0x09, 0x02, 0x00, 0x80});
  Write({0x2F, 0x00, 0x14, 0x02, 0x01, 0, 0, 0});
  Write({0x2F, 0x00, 0x16, 0x00, 0x00, 0, 0, 0});
  Write({0x23, 0x00, 0x16, 0x01, 0x10, 0x00, 0x40, 0x60});
  Write({0x23, 0x00, 0x16, 0x02, 0x10, 0x00, 0x71, 0x60});
  Write({0x2F, 0x00, 0x16, 0x00, 0x02, 0, 0, 0});
  Write({0x23, 0x00, 0x14, 0x01, 0x09, 0x02, 0x00, 0x00});
  Write({0x2F, 0x60, 0x60, 0x00, 0x0A, 0, 0, 0});
  Send(0x000, {0x01, 0x09});
  for (std::uint8_t controlword : {0x06, 0x07, 0x0F}) {
    Send(0x209, {controlword, 0x00, 0xF4, 0x01});
    EXPECT_EQ(rack_->torque_Nm(0), 0.0);
    Send(0x080, {});
    const Bytes shown = Next(0x189);
    EXPECT_EQ(shown.size(), 2u) << "statusword on change";
  }
  EXPECT_TRUE(rack_->enabled(0));
  EXPECT_NEAR(rack_->torque_Nm(0), 0.5 * 7056e-6, 1e-12);
}

}  // namespace
}  // namespace tendril::emulator
