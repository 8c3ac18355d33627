// The SDO client against frames written by hand: both ways, both transfers, and everything late, lost or
// mixed up. No server of ours is involved.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tendril/canopen/sdo.h"

namespace tendril::canopen {
namespace {

using ::testing::ElementsAre;
using State = SdoClient::State;

constexpr TimeNs kTimeout_ns = 50 * kNsPerMs;

class SdoClientTest : public ::testing::Test {
 protected:
  /// The waiting frame's bytes; empty when none waits. Counts as sent.
  std::vector<int> Sent() {
    if (client.pending() == nullptr) return {};
    const can::CanFrame frame = *client.pending();
    EXPECT_EQ(frame.id, 0x604u);
    client.FrameSent(now_ns);
    return {frame.data.begin(), frame.data.begin() + frame.size};
  }
  void Reply(std::initializer_list<int> bytes) {
    can::CanFrame frame;
    frame.id = 0x584;
    for (int byte : bytes) frame.data[frame.size++] = static_cast<std::uint8_t>(byte);
    client.OnFrame(frame);
  }
  std::string Text() const { return {client.data().begin(), client.data().end()}; }

  SdoClient client{4};
  TimeNs now_ns = 0;
};

TEST_F(SdoClientTest, ExpeditedUpload) {
  client.Upload({0x6041, 0}, kTimeout_ns);
  EXPECT_THAT(Sent(), ElementsAre(0x40, 0x41, 0x60, 0x00, 0, 0, 0, 0));
  Reply({0x4B, 0x41, 0x60, 0x00, 0x37, 0x12, 0, 0});
  EXPECT_EQ(client.state(), State::kDone);
  EXPECT_EQ(client.data().size(), 2u);
  EXPECT_EQ(client.value(), 0x1237u);
}

TEST_F(SdoClientTest, ExpeditedUploadWithoutASizeIsFourBytes) {
  client.Upload({0x6041, 0}, kTimeout_ns);
  Sent();
  Reply({0x42, 0x41, 0x60, 0x00, 1, 2, 3, 4});
  EXPECT_EQ(client.state(), State::kDone);
  EXPECT_EQ(client.value(), 0x04030201u);
}

TEST_F(SdoClientTest, ExpeditedDownload) {
  const std::array<std::uint8_t, 1> mode{10};
  client.Download({0x6060, 0}, mode, kTimeout_ns);
  EXPECT_THAT(Sent(), ElementsAre(0x2F, 0x60, 0x60, 0x00, 10, 0, 0, 0));
  Reply({0x60, 0x60, 0x60, 0x00, 0, 0, 0, 0});
  EXPECT_EQ(client.state(), State::kDone);
}

TEST_F(SdoClientTest, SegmentedUpload) {
  client.Upload({0x1008, 0}, kTimeout_ns);
  Sent();
  Reply({0x41, 0x08, 0x10, 0x00, 9, 0, 0, 0});
  EXPECT_THAT(Sent(), ElementsAre(0x60, 0, 0, 0, 0, 0, 0, 0));
  Reply({0x00, 'E', 'P', 'O', 'S', '4', ' ', '5'});
  EXPECT_THAT(Sent(), ElementsAre(0x70, 0, 0, 0, 0, 0, 0, 0));
  Reply({0x1B, '0', '!', 0, 0, 0, 0, 0});
  EXPECT_EQ(client.state(), State::kDone);
  EXPECT_EQ(Text(), "EPOS4 50!");
  EXPECT_EQ(client.pending(), nullptr);
}

TEST_F(SdoClientTest, SegmentedDownload) {
  const std::string text = "nine byte";
  client.Download({0x2000, 3}, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()},
                  kTimeout_ns);
  EXPECT_THAT(Sent(), ElementsAre(0x21, 0x00, 0x20, 0x03, 9, 0, 0, 0));
  Reply({0x60, 0x00, 0x20, 0x03, 0, 0, 0, 0});
  EXPECT_THAT(Sent(), ElementsAre(0x00, 'n', 'i', 'n', 'e', ' ', 'b', 'y'));
  Reply({0x20, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_THAT(Sent(), ElementsAre(0x1B, 't', 'e', 0, 0, 0, 0, 0));
  EXPECT_TRUE(client.busy());
  Reply({0x30, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_EQ(client.state(), State::kDone);
}

TEST_F(SdoClientTest, WrongToggleAborts) {
  client.Upload({0x1008, 0}, kTimeout_ns);
  Sent();
  Reply({0x41, 0x08, 0x10, 0x00, 9, 0, 0, 0});
  Sent();
  Reply({0x10, 'E', 'P', 'O', 'S', '4', ' ', '5'});
  EXPECT_EQ(client.state(), State::kAborted);
  EXPECT_EQ(client.abort_code(), 0x05030000u);
  EXPECT_THAT(Sent(), ElementsAre(0x80, 0x08, 0x10, 0x00, 0x00, 0x00, 0x03, 0x05)) << "the server is told";
}

TEST_F(SdoClientTest, FewerBytesThanAnnouncedAbort) {
  client.Upload({0x1008, 0}, kTimeout_ns);
  Sent();
  Reply({0x41, 0x08, 0x10, 0x00, 9, 0, 0, 0});
  Sent();
  Reply({0x05, 'E', 'P', 'O', 'S', '4', 0, 0});
  EXPECT_EQ(client.state(), State::kAborted);
  EXPECT_EQ(client.abort_code(), 0x06070010u);
}

TEST_F(SdoClientTest, MoreThanFitsAborts) {
  client.Upload({0x1008, 0}, kTimeout_ns);
  Sent();
  Reply({0x41, 0x08, 0x10, 0x00, 0x01, 0x01, 0, 0});  // 257 bytes
  EXPECT_EQ(client.state(), State::kAborted);
  EXPECT_EQ(client.abort_code(), 0x05040005u);

  client.Upload({0x1008, 0}, kTimeout_ns);
  Sent();
  Reply({0x40, 0x08, 0x10, 0x00, 0, 0, 0, 0});  // names no size, never ends
  bool toggle = false;
  for (int i = 0; i < 100 && client.busy(); ++i) {
    Sent();
    Reply({toggle ? 0x10 : 0x00, 1, 2, 3, 4, 5, 6, 7});
    toggle = !toggle;
  }
  EXPECT_EQ(client.state(), State::kAborted);
}

TEST_F(SdoClientTest, ServersAbortIsKept) {
  const std::array<std::uint8_t, 2> value{1, 0};
  client.Download({0x605A, 0}, value, kTimeout_ns);
  Sent();
  Reply({0x80, 0x5A, 0x60, 0x00, 0x30, 0x00, 0x09, 0x06});
  EXPECT_EQ(client.state(), State::kAborted);
  EXPECT_EQ(client.abort_code(), 0x06090030u);
  EXPECT_EQ(client.pending(), nullptr) << "an abort is not answered";
}

TEST_F(SdoClientTest, TimeOutTellsTheServerAndLateRepliesAreDiscarded) {
  client.Upload({0x6041, 0}, kTimeout_ns);
  now_ns = 1000;
  client.Poll(now_ns + kTimeout_ns);
  EXPECT_TRUE(client.busy()) << "time runs from the sending, not from the asking";
  Sent();
  client.Poll(now_ns + kTimeout_ns - 1);
  EXPECT_TRUE(client.busy());
  client.Poll(now_ns + kTimeout_ns);
  EXPECT_EQ(client.state(), State::kTimedOut);
  EXPECT_THAT(Sent(), ElementsAre(0x80, 0x41, 0x60, 0x00, 0x00, 0x00, 0x04, 0x05));

  // The next request; then the late reply of the first.
  client.Upload({0x6061, 0}, kTimeout_ns);
  Sent();
  Reply({0x4B, 0x41, 0x60, 0x00, 0x37, 0x12, 0, 0});
  EXPECT_TRUE(client.busy());
  EXPECT_EQ(client.stale_replies(), 1u);
  Reply({0x4F, 0x61, 0x60, 0x00, 10, 0, 0, 0});
  EXPECT_EQ(client.state(), State::kDone);
  EXPECT_EQ(client.value(), 10u);
  Reply({0x4F, 0x61, 0x60, 0x00, 9, 0, 0, 0});
  EXPECT_EQ(client.value(), 10u);
  EXPECT_EQ(client.stale_replies(), 2u);
}

TEST_F(SdoClientTest, ReplyOfAnotherKindIsDiscarded) {
  const std::array<std::uint8_t, 1> mode{10};
  client.Download({0x6060, 0}, mode, kTimeout_ns);
  Sent();
  Reply({0x4F, 0x60, 0x60, 0x00, 1, 0, 0, 0});  // an upload's reply
  Reply({0x60, 0x61, 0x60, 0x00, 0, 0, 0, 0});  // of another object
  Reply({0x80, 0x61, 0x60, 0x00, 0, 0, 2, 6});  // an abort of another object
  Reply({0x20, 0, 0, 0, 0, 0, 0, 0});           // a segment's
  Reply({0xA4, 0x60, 0x60, 0x00, 0, 0, 0, 0});  // block transfer
  Reply({0x60, 0x60, 0x60});                    // cut off
  EXPECT_TRUE(client.busy());
  EXPECT_EQ(client.stale_replies(), 6u);
  Reply({0x60, 0x60, 0x60, 0x00, 0, 0, 0, 0});
  EXPECT_EQ(client.state(), State::kDone);
}

TEST_F(SdoClientTest, ReplyBeforeTheRequestLeftIsDiscarded) {
  client.Upload({0x6041, 0}, kTimeout_ns);
  Reply({0x4B, 0x41, 0x60, 0x00, 0x08, 0x00, 0, 0});
  EXPECT_TRUE(client.busy());
  Sent();
  Reply({0x4B, 0x41, 0x60, 0x00, 0x37, 0x12, 0, 0});
  EXPECT_EQ(client.value(), 0x1237u);
}

}  // namespace
}  // namespace tendril::canopen
