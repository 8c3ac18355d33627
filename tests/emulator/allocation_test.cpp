// The emulator's cycle allocates nothing, so that a plant on it keeps its real-time factor.
// Speaks bare frames; knows nothing of the emulator's inside.
#include <gtest/gtest.h>

#include "raw_master.h"
#include "support/allocation_count.h"

namespace tendril::emulator {
namespace {

TEST(Allocation, TheCycleAllocatesNothing) {
  RawMaster m({RawMaster::Drive(1), RawMaster::Drive(2), RawMaster::Drive(3)});
  for (int node = 1; node <= 3; ++node) {
    ASSERT_EQ((m.Poll(), m.Write(0x1017, 0, 10, 2, node)), 0u);
    m.Enable(node);
  }
  can::CanFrame sync, command;
  sync.id = 0x080;
  command.size = 4;
  command.data[0] = 0x0F;
  std::array<can::StampedFrame, 64> sink;
  const std::uint64_t before = test::AllocationCount();
  TimeNs now_ns = m.now();
  for (int i = 0; i < 1000; ++i) {
    now_ns += kNsPerMs;
    m.port().Send(sync);
    for (std::uint32_t node = 1; node <= 3; ++node) {
      command.id = 0x200 + node;
      command.data[2] = static_cast<std::uint8_t>(i);
      m.port().Send(command);
    }
    m.rack().SetSensors(0,
                        {.position_counts = i, .velocity_rpm = 0, .actual_torque_Nm = 1e-3, .analog_mV = {}});
    m.rack().Poll(now_ns);
    m.port().Receive(sink);
  }
  EXPECT_EQ(test::AllocationCount(), before);
  EXPECT_TRUE(m.rack().enabled(0));
}

}  // namespace
}  // namespace tendril::emulator
