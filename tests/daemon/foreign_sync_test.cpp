// A bus has one master: another one is noticed before ours begins.
// Knows the memory bus only.
#include "tendril/daemon/foreign_sync.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tendril/can/memory_bus.h"

namespace tendril::daemon {
namespace {

TEST(ForeignSync, AnotherMasterIsNoticedAndOtherFramesAreNot) {
  const MonotonicClock clock;
  can::MemoryBus bus(clock);
  can::CanPort& ours = bus.AddPort();
  can::CanPort& theirs = bus.AddPort();
  can::CanFrame heartbeat{.id = 0x701, .size = 1};
  theirs.Send(heartbeat);
  EXPECT_NO_THROW(RefuseForeignSync(ours, clock, "can0", 5 * kNsPerMs));
  theirs.Send({.id = 0x080});
  EXPECT_THROW(RefuseForeignSync(ours, clock, "can0", 5 * kNsPerMs), std::runtime_error);
}

}  // namespace
}  // namespace tendril::daemon
