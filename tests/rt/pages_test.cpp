// What cycles use first has been touched before: no page is fetched, also where memory may not be locked. Not
// under a sanitizer, whose own memory is fetched with what it watches.
#include <gtest/gtest.h>

#include <array>
#include <thread>

#include "tendril/rt/cyclic.h"
#include "tendril/rt/handoff.h"
#include "tendril/rt/usage.h"

namespace tendril::rt {
namespace {

using Value = std::array<std::uint64_t, 64>;

TEST(EnterRealtime, FirstUsesFetchNoPages) {
  constexpr std::size_t kPages = 256, kPage = 4096;
  static std::array<unsigned char, kPages * kPage> never_used;
  std::thread([] {
    RealtimeParameters p;
    p.lock_memory = false;
    EXPECT_EQ(EnterRealtime(p), "");
    const volatile unsigned char* bytes = never_used.data();
    unsigned sum = 0;
    const std::uint64_t before = ReadThreadUsage().minor_faults;
    for (std::size_t page = 0; page < kPages; ++page) sum += bytes[page * kPage];
    EXPECT_EQ(ReadThreadUsage().minor_faults, before);
    EXPECT_EQ(sum, 0U);
  }).join();
}

// Its first round through its memory is in cycles.
TEST(Handoff, HasTouchedAllOfItsMemory) {
  constexpr int kCapacity = 4096;  // 2 MB: more than what was used and given back before
  Handoff<Value> handoff(kCapacity);
  const std::uint64_t before = ReadThreadUsage().minor_faults;
  for (int i = 0; i < kCapacity; ++i) handoff.TryPush({});
  EXPECT_EQ(ReadThreadUsage().minor_faults, before);
  EXPECT_EQ(handoff.dropped(), 0U);
}

}  // namespace
}  // namespace tendril::rt
