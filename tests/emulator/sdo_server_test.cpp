// Segmented transfers of every length, which no object of the drive is long enough for.
// Frames are written by hand; knows the server and nothing of the drive.
#include "emulator/sdo_server.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace tendril::emulator {
namespace {

using Bytes = std::vector<std::uint8_t>;

class OneObject final : public SdoObjects {
 public:
  std::uint32_t Read(canopen::ObjectAddress, std::span<std::uint8_t> to, std::size_t* size) override {
    *size = value.size();
    std::copy(value.begin(), value.end(), to.begin());
    return 0;
  }
  std::uint32_t Write(canopen::ObjectAddress, std::span<const std::uint8_t> from, bool) override {
    value.assign(from.begin(), from.end());
    ++writes;
    return 0;
  }
  Bytes value;
  int writes = 0;
};

class SdoServerTest : public ::testing::Test {
 protected:
  Bytes Ask(const Bytes& request) {
    can::CanFrame frame, answer;
    frame.id = 0x601;
    frame.size = 8;
    std::copy(request.begin(), request.end(), frame.data.begin());
    if (!server_.Answer(frame, &answer)) return {};
    EXPECT_EQ(answer.id, 0x581u);
    EXPECT_EQ(answer.size, 8);
    return {answer.data.begin(), answer.data.end()};
  }

  static Bytes Pattern(std::size_t n) {
    Bytes b(n);
    for (std::size_t i = 0; i < n; ++i) b[i] = static_cast<std::uint8_t>(i * 37 + 1);
    return b;
  }

  OneObject object_;
  SdoServer server_{1, object_};
};

TEST_F(SdoServerTest, UploadsOfEveryLength) {
  for (std::size_t n = 5; n <= 256; ++n) {
    object_.value = Pattern(n);
    const Bytes start = Ask({0x40, 0, 0x20, 0, 0, 0, 0, 0});
    ASSERT_EQ(start[0], 0x41);
    ASSERT_EQ(start[4] | start[5] << 8, static_cast<int>(n));
    Bytes got;
    for (std::uint8_t toggle = 0;; toggle ^= 0x10) {
      const Bytes segment = Ask({static_cast<std::uint8_t>(0x60 | toggle), 0, 0, 0, 0, 0, 0, 0});
      ASSERT_EQ(segment[0] & 0xF0, toggle);
      got.insert(got.end(), segment.begin() + 1, segment.end() - ((segment[0] >> 1) & 7));
      if (segment[0] & 1) break;
      ASSERT_LT(got.size(), n);
    }
    ASSERT_EQ(got, object_.value);
    ASSERT_EQ(Ask({0x60, 0, 0, 0, 0, 0, 0, 0})[0], 0x80) << "nothing is left to send";
  }
}

TEST_F(SdoServerTest, DownloadsOfEveryLength) {
  for (std::size_t n = 1; n <= 256; ++n) {
    const Bytes value = Pattern(n);
    ASSERT_EQ(
        Ask({0x21, 0, 0x20, 0, static_cast<std::uint8_t>(n), static_cast<std::uint8_t>(n >> 8), 0, 0})[0],
        0x60);
    std::uint8_t toggle = 0;
    for (std::size_t at = 0; at < n; at += 7, toggle ^= 0x10) {
      const std::size_t k = std::min<std::size_t>(7, n - at);
      Bytes segment(8, 0);
      segment[0] = static_cast<std::uint8_t>(toggle | (7 - k) << 1 | (at + k == n ? 1 : 0));
      std::copy_n(value.begin() + static_cast<std::ptrdiff_t>(at), k, segment.begin() + 1);
      ASSERT_EQ(Ask(segment)[0], 0x20 | toggle);
    }
    ASSERT_EQ(object_.value, value);
  }
  EXPECT_EQ(object_.writes, 256);
}

TEST_F(SdoServerTest, ARepeatedSegmentOrAWrongLengthAborts) {
  Ask({0x21, 0, 0x20, 0, 10, 0, 0, 0});
  Ask({0x00, 1, 2, 3, 4, 5, 6, 7});
  Bytes answer = Ask({0x00, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(answer, (Bytes{0x80, 0, 0x20, 0, 0x00, 0x00, 0x03, 0x05}));

  Ask({0x21, 0, 0x20, 0, 10, 0, 0, 0});
  answer = Ask({0x01, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(answer, (Bytes{0x80, 0, 0x20, 0, 0x10, 0x00, 0x07, 0x06}))
      << "seven bytes where ten were promised";
  EXPECT_EQ(object_.writes, 0);
}

TEST_F(SdoServerTest, ANewStartReplacesATransferUnderWay) {
  object_.value = Pattern(20);
  Ask({0x21, 0, 0x20, 0, 10, 0, 0, 0});
  EXPECT_EQ(Ask({0x40, 0, 0x20, 0, 0, 0, 0, 0})[0], 0x41);
  EXPECT_EQ(Ask({0x60, 0, 0, 0, 0, 0, 0, 0})[1], 1);
}

}  // namespace
}  // namespace tendril::emulator
