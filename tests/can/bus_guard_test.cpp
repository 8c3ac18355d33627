// One program of a kind a bus.
// Knows the kernel's names only, no CAN interface.
#include "tendril/can/bus_guard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <optional>
#include <stdexcept>

namespace tendril::can {
namespace {

using testing::HasSubstr;

// Names no other test run uses at the same time.
std::string Interface(const char* name) { return std::string(name) + std::to_string(getpid()); }

TEST(BusGuard, TheSecondOnOneInterfaceIsToldWhoTheFirstIs) {
  std::optional<BusGuard> first(std::in_place, "tendrild", Interface("can"));
  const BusGuard on_another_bus("tendrild", Interface("vcan"));
  const BusGuard of_another_kind("tendril-plant", Interface("can"));
  try {
    const BusGuard second("tendrild", Interface("can"));
    ADD_FAILURE() << "not refused";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("another tendrild is on " + Interface("can") + " already (process " +
                                    std::to_string(getpid()) + ")"));
  }
  first.reset();
  EXPECT_NO_THROW(BusGuard("tendrild", Interface("can")));
}

}  // namespace
}  // namespace tendril::can
