// What must hold whatever arrives: no crash on random frames, no invalid torque.
// Speaks bare frames; knows nothing of the emulator's inside.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "raw_master.h"

namespace tendril::emulator {
namespace {

constexpr double kLimit_Nm = 2 * 7056e-6;  // output current limit: twice nominal, when nobody changes it

TEST(Robustness, RandomFramesNeitherCrashNorGiveTorqueBeyondTheLimit) {
  std::mt19937 random(7);
  RawMaster m({RawMaster::Drive(1), RawMaster::Drive(2)});
  m.Enable(1);
  const std::uint32_t ids[] = {0x000, 0x080, 0x081, 0x200, 0x201, 0x202, 0x301, 0x401, 0x501,
                               0x601, 0x602, 0x67F, 0x701, 0x77F, 0x181, 0x281, 0x7FF};
  std::vector<can::StampedFrame> sink(1024);
  for (int i = 0; i < 300'000; ++i) {
    const std::uint32_t id = random() % 8 == 0 ? random() % 0x800 : ids[random() % std::size(ids)];
    Bytes data(random() % 9);
    for (auto& b : data) b = static_cast<std::uint8_t>(random());
    // Half of the SDO requests name an object that exists and a sensible command, to come further than the
    // decoder.
    if ((id == 0x601 || id == 0x602) && random() % 2 == 0) {
      static constexpr std::uint16_t kIndex[] = {0x1016, 0x1017, 0x1400, 0x1600, 0x1800, 0x1A00,
                                                 0x6040, 0x6060, 0x6071, 0x1008, 0x1010, 0x1011,
                                                 0x605C, 0x6007, 0x6085, 0x1A03};
      static constexpr std::uint8_t kCommand[] = {0x40, 0x23, 0x2B, 0x2F, 0x22, 0x21, 0x60, 0x70, 0x01, 0x10};
      const std::uint16_t index = kIndex[random() % std::size(kIndex)];
      data.resize(8);
      data[0] = kCommand[random() % std::size(kCommand)];
      data[1] = static_cast<std::uint8_t>(index);
      data[2] = static_cast<std::uint8_t>(index >> 8);
      data[3] = static_cast<std::uint8_t>(random() % 5);
      if (random() % 2 == 0) data[5] = data[6] = data[7] = 0;
    }
    m.Send(id, data, random() % 16 == 0);
    if (random() % 4 == 0) {
      m.rack().Poll(m.now() + i * kNsPerMs / 4);
      for (int d = 0; d < 2; ++d) {
        ASSERT_TRUE(std::isfinite(m.rack().torque_Nm(d)));
        ASSERT_LE(std::abs(m.rack().torque_Nm(d)), kLimit_Nm * (1 + 1e-9));
        ASSERT_TRUE(m.rack().enabled(d) || m.rack().torque_Nm(d) == 0.0);
      }
      m.port().Receive(sink);
    }
  }
  m.rack().PowerCycle(0);
  m.Poll();
  EXPECT_EQ(m.Read(0x1000, 0).number(), 0x00020192u) << "still alive";
}

}  // namespace
}  // namespace tendril::emulator
