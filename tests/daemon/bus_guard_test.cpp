// One master a bus.
#include "tendril/daemon/bus_guard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <optional>
#include <stdexcept>

#include "tendril/can/memory_bus.h"

namespace tendril::daemon {
namespace {

using testing::HasSubstr;

// Names no other test run uses at the same time.
std::string Interface(const char* name) { return std::string(name) + std::to_string(getpid()); }

TEST(BusGuard, TheSecondOnOneInterfaceIsToldWhoTheFirstIs) {
  std::optional<BusGuard> first(Interface("can"));
  const BusGuard other(Interface("vcan"));
  try {
    const BusGuard second(Interface("can"));
    ADD_FAILURE() << "not refused";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("another tendrild already drives " + Interface("can") + " (process " +
                                    std::to_string(getpid()) + ")"));
  }
  first.reset();
  EXPECT_NO_THROW(BusGuard(Interface("can")));
}

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
