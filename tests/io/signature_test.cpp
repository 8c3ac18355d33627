// Signatures: of this key, fresh, once; anything else is refused with the reason.
#include "tendril/io/signature.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <random>
#include <vector>

#include "random_record.h"
#include "tendril/io/client.h"
#include "tendril/io/epoch.h"
#include "tendril/io/gateway.h"
#include "tendril/io/wire.h"

namespace tendril::io {
namespace {

using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

const std::string kKey = "0123456789abcdef0123456789abcdef", kChannel = "TENDRIL_COMMAND_MODE";
constexpr std::int64_t kNow_us = 1'800'000'000'000'000;

std::string File(const std::string& name, const std::string& content, mode_t mode = 0600) {
  const std::string path = testing::TempDir() + name;
  std::ofstream(path, std::ios::binary) << content;
  chmod(path.c_str(), mode);
  return path;
}

std::string Why(Verifier& verifier, const Bytes& message, std::int64_t now_us = kNow_us,
                const std::string& channel = kChannel) {
  return verifier.Refusal(channel, message.data(), message.size(), now_us);
}

Bytes Signed(Signer& signer, std::int64_t at_us = kNow_us) {
  Bytes message{1, 2, 3};
  signer.Sign(kChannel, at_us, message);
  return message;
}

TEST(Signature, FollowsTheMessageWithMarkAndTime) {
  Signer signer(kKey);
  const Bytes message = Signed(signer);
  ASSERT_EQ(message.size(), 3 + kSignatureBytes);
  EXPECT_EQ(std::string(message.begin() + 3, message.begin() + 11), "TENDSIG1");
  std::uint64_t time = 0;
  for (int i = 15; i < 23; ++i) time = time << 8 | message[static_cast<std::size_t>(i)];
  EXPECT_EQ(time, static_cast<std::uint64_t>(kNow_us));
  EXPECT_EQ(UnsignedSize(message.data(), message.size()), 3u);
  EXPECT_EQ(UnsignedSize(message.data(), 3), 3u);
}

// Made by Python's hmac and hashlib from the layout in the header.
TEST(Signature, OfAnotherProgramIsAccepted) {
  const Bytes message{0x01, 0x02, 0x03, 0x54, 0x45, 0x4e, 0x44, 0x53, 0x49, 0x47, 0x31, 0xaa, 0xbb, 0xcc,
                      0xdd, 0x00, 0x06, 0x65, 0x17, 0x28, 0x98, 0x80, 0x00, 0x70, 0x66, 0x9d, 0x16, 0x5e,
                      0xaf, 0x4f, 0x06, 0xac, 0x84, 0x18, 0xf3, 0x59, 0xfb, 0xad, 0x12, 0xf7, 0xcf, 0x28,
                      0xd2, 0xca, 0x21, 0x9a, 0x86, 0x70, 0xb0, 0x26, 0x54, 0xeb, 0x72, 0x8e, 0x4b};
  Verifier verifier(kKey, 0);
  EXPECT_EQ(Why(verifier, message), "");
}

TEST(Signature, IsAcceptedOnce) {
  Signer signer(kKey), other(kKey);
  Verifier verifier(kKey, kNow_us - 1'000'000);
  const Bytes first = Signed(signer), second = Signed(signer), of_other = Signed(other);
  EXPECT_EQ(Why(verifier, first), "");
  EXPECT_THAT(Why(verifier, first), HasSubstr("was received before"));
  EXPECT_EQ(Why(verifier, second), "");
  EXPECT_THAT(Why(verifier, first), HasSubstr("was received before"));
  EXPECT_EQ(Why(verifier, of_other), "");
}

TEST(Signature, EveryBitCounts) {
  Signer signer(kKey);
  Verifier verifier(kKey, 0);
  const Bytes message = Signed(signer);
  for (std::size_t bit = 0; bit < 8 * message.size(); ++bit) {
    Bytes changed = message;
    changed[bit / 8] = static_cast<std::uint8_t>(changed[bit / 8] ^ (1u << bit % 8));
    EXPECT_NE(Why(verifier, changed), "") << bit;
  }
  EXPECT_THAT(Why(verifier, message, kNow_us, "TENDRIL_COMMAND_TIP"),
              HasSubstr("another key, or was changed"));
  EXPECT_EQ(Why(verifier, message), "");
}

TEST(Signature, WhatIsNotSignedOrOldOrOfAnotherKeyIsRefusedWithTheRemedy) {
  Signer signer(kKey), stranger(std::string(32, 'x'));
  Verifier verifier(kKey, kNow_us - 5'000'000);
  EXPECT_THAT(Why(verifier, {1, 2, 3}), HasSubstr("not signed, and lcm.key_file asks for that"));
  EXPECT_THAT(Why(verifier, {}), HasSubstr("not signed"));
  EXPECT_THAT(Why(verifier, Signed(stranger)), HasSubstr("another key"));
  EXPECT_THAT(Why(verifier, Signed(signer, kNow_us - 6'000'000)), HasSubstr("before this daemon started"));
  Signer late(kKey), early(kKey);
  EXPECT_THAT(Why(verifier, Signed(late, kNow_us - 60'000'000)), HasSubstr("60.0 s ago"));
  EXPECT_THAT(Why(verifier, Signed(early, kNow_us + 60'000'000)), HasSubstr("60.0 s from now"));
}

// Rubbish of every length, and signed messages with bytes exchanged: no crash, nothing accepted.
TEST(Signature, RubbishIsRefused) {
  std::mt19937 random(5);
  Signer signer(kKey);
  Verifier verifier(kKey, 0);
  for (int i = 0; i < 20'000; ++i) {
    Bytes bytes(random() % 200);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    if (i % 2 == 0) {
      signer.Sign(kChannel, kNow_us, bytes);
      bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
    }
    EXPECT_NE(Why(verifier, bytes), "");
  }
}

TEST(Signature, OfMoreSendersThanAreKeptTheOldOnesAreForgotten) {
  Verifier verifier(kKey, 0);
  Signer kept(kKey);
  std::int64_t now_us = kNow_us;
  for (int i = 0; i < 10'050; ++i, now_us += 2'000) {
    Signer signer(kKey);
    EXPECT_EQ(Why(verifier, Signed(signer, now_us), now_us), "");
  }
  const Bytes last = Signed(kept, now_us);
  EXPECT_EQ(Why(verifier, last, now_us), "");
  EXPECT_THAT(Why(verifier, last, now_us), HasSubstr("was received before"));
}

TEST(Key, IsReadWithoutItsLineEndAndRefusedWithTheRemedy) {
  EXPECT_EQ(LoadKey(File("key", kKey + "\n")), kKey);
  EXPECT_THAT([] { LoadKey(File("short", "secret\n")); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("6 bytes; accepted: 32 to 4096")));
  EXPECT_THAT([] { LoadKey(File("open", kKey, 0644)); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("chmod o-r")));
  EXPECT_THAT([] { LoadKey(File("long", std::string(100'000, 'k'))); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("accepted: 32 to 4096")));
  EXPECT_THAT([] { LoadKey("/nonexistent/key"); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("openssl rand -hex 32")));
}

class SignedGateway : public testing::Test {
 protected:
  SignedGateway() {
    gateway.OnCommand([this](const Command&) { ++commands; });
    gateway.OnComplaint([this](Status, const std::string& text) { complaint = text; });
  }
  ~SignedGateway() override { unsetenv("TENDRIL_KEY_FILE"); }

  void Send(const std::string& with) {
    if (with.empty()) {
      unsetenv("TENDRIL_KEY_FILE");
    } else {
      setenv("TENDRIL_KEY_FILE", with.c_str(), 1);
    }
    Client client(gateway.lcm(), "TENDRIL");
    Command disarm;
    disarm.kind = CommandKind::kMode;
    disarm.mode = ModeRequest::kDisarm;
    ASSERT_TRUE(client.Send(disarm, EpochUs()));
    while (gateway.Handle(0) > 0) {
    }
    ignored = client.ignored();
  }

  const std::string key_file = File("gate_key", kKey);
  MonotonicClock clock;
  Gateway gateway{{"memq://", "TENDRIL", 1, 1, key_file}, kShape, clock};
  int commands = 0;
  std::string complaint, ignored;
};

TEST_F(SignedGateway, TakesTheCommandsOfWhoHasTheKey) {
  Send(key_file);
  EXPECT_EQ(commands, 1);
  EXPECT_EQ(complaint, "");
}

TEST_F(SignedGateway, IgnoresOthersAndTellsThem) {
  Send("");
  EXPECT_EQ(commands, 0);
  EXPECT_THAT(complaint, HasSubstr("TENDRIL_COMMAND_MODE: message ignored: it is not signed"));
  EXPECT_EQ(ignored, complaint);
  EXPECT_EQ(gateway.counters().undecodable, 1u);
  Send(File("other_key", std::string(40, 'y')));
  EXPECT_EQ(commands, 0);
}

TEST_F(SignedGateway, ARecordedCommandIsTakenOnce) {
  Bytes recorded;
  auto* subscription = gateway.lcm()->subscribeFunction(
      "TENDRIL_COMMAND_MODE",
      +[](const lcm::ReceiveBuffer* bytes, const std::string&, Bytes* to) {
        const auto* data = static_cast<const std::uint8_t*>(bytes->data);
        to->assign(data, data + bytes->data_size);
      },
      &recorded);
  Send(key_file);
  ASSERT_EQ(commands, 1);
  gateway.lcm()->unsubscribe(subscription);
  gateway.lcm()->publish("TENDRIL_COMMAND_MODE", recorded.data(), static_cast<unsigned>(recorded.size()));
  while (gateway.Handle(0) > 0) {
  }
  EXPECT_EQ(commands, 1);
  EXPECT_THAT(complaint, HasSubstr("was received before"));
}

TEST(UnsignedGateway, TakesSignedCommandsToo) {
  const std::string key_file = File("some_key", kKey);
  setenv("TENDRIL_KEY_FILE", key_file.c_str(), 1);
  MonotonicClock clock;
  Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
  int commands = 0;
  gateway.OnCommand([&](const Command&) { ++commands; });
  Client client(gateway.lcm(), "TENDRIL");
  Command arm;
  arm.kind = CommandKind::kMode;
  arm.mode = ModeRequest::kArm;
  EXPECT_TRUE(client.Send(arm, EpochUs()));
  while (gateway.Handle(0) > 0) {
  }
  EXPECT_EQ(commands, 1);
  unsetenv("TENDRIL_KEY_FILE");
}

}  // namespace
}  // namespace tendril::io
