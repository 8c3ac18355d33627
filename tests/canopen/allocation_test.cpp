// The master's cycle allocates nothing, whatever happens to bus and drives. A program of its own: its
// counting takes the place of a sanitizer's.
#include <gtest/gtest.h>

#include "fake_node.h"
#include "support/allocation_count.h"

namespace tendril::canopen::test {
namespace {

TEST(RealTime, NoAllocationFromStartThroughFaultsToShutdown) {
  Rig rig(3);
  std::uint64_t inside = 0;
  const auto count = [&inside](auto&& call) {
    const std::uint64_t before = tendril::test::AllocationCount();
    call();
    inside += tendril::test::AllocationCount() - before;
  };
  const auto steps = [&](int n) {
    for (int i = 0; i < n; ++i) {
      rig.clock.Advance(rig.cycle_ns);
      const TimeNs now_ns = rig.clock.Now();
      count([&] { rig.master.BeginCycle(now_ns); });
      rig.PollNodes();
      count([&] { rig.master.Poll(now_ns); });
      count([&] { rig.master.EndCycle(now_ns, rig.request, rig.torques); });
      BusEvent event;
      count([&] {
        while (rig.master.PopEvent(&event)) {
        }
      });
    }
  };
  count([&] { rig.master.Start(rig.clock.Now()); });
  steps(500);
  rig.request = DriveRequest::kEnable;
  steps(100);
  ASSERT_EQ(rig.master.feedback(2).state, DriveState::kEnabled);
  rig.nodes[0]->SayEmcy(0x4380, 0x08);
  rig.nodes[0]->machine = DriveMachine::kFault;
  rig.nodes[1]->powered = false;
  steps(500);
  rig.bus.SetBusOff(true);
  steps(10);
  rig.bus.SetBusOff(false);
  rig.nodes[1]->powered = true;
  rig.request = DriveRequest::kDisable;
  steps(10);
  count([&] { rig.master.ClearFaults(rig.clock.Now()); });
  steps(800);
  ASSERT_EQ(rig.master.feedback(0).state, DriveState::kReady);
  ASSERT_EQ(rig.master.feedback(1).state, DriveState::kReady);
  EXPECT_EQ(inside, 0u);
}

}  // namespace
}  // namespace tendril::canopen::test
