// Between two threads: order kept, nothing torn, what did not fit is counted.
#include "tendril/rt/handoff.h"

#include <gtest/gtest.h>

#include <array>
#include <thread>

namespace tendril::rt {
namespace {

using Value = std::array<std::uint64_t, 64>;  // far more than one cache line

TEST(Handoff, OrderIsKeptNothingIsTornAndDropsAreCounted) {
  constexpr std::uint64_t kCount = 200'000;
  Handoff<Value> handoff(64);
  std::uint64_t attempts = 0;
  std::thread producer([&] {
    Value value;
    for (std::uint64_t i = 1; i <= kCount; ++i) {
      value.fill(i);
      handoff.TryPush(value);
      if (i % 256 == 0) std::this_thread::yield();
    }
    // The last one must arrive, so that the other side can end.
    value.fill(kCount + 1);
    std::uint64_t tries = 1;
    for (; !handoff.TryPush(value); ++tries) std::this_thread::yield();
    attempts = kCount + tries;
  });
  std::uint64_t last = 0, received = 0;
  bool torn = false;
  Value value;
  while (last <= kCount) {
    if (!handoff.TryPop(value)) {
      std::this_thread::yield();
      continue;
    }
    for (const std::uint64_t v : value) torn = torn || v != value[0];
    ASSERT_GT(value[0], last);
    last = value[0];
    ++received;
  }
  producer.join();
  EXPECT_FALSE(torn);
  EXPECT_EQ(received + handoff.dropped(), attempts);
  EXPECT_FALSE(handoff.TryPop(value));
}

TEST(Handoff, AFullQueueDropsTheNewest) {
  Handoff<int> handoff(4);
  int pushed = 0;
  while (handoff.TryPush(pushed)) ++pushed;
  EXPECT_GE(pushed, 4);
  EXPECT_EQ(handoff.dropped(), 1U);
  int value = -1;
  for (int i = 0; i < pushed; ++i) {
    ASSERT_TRUE(handoff.TryPop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(handoff.TryPop(value));
  EXPECT_TRUE(handoff.TryPush(7));
}

}  // namespace
}  // namespace tendril::rt
