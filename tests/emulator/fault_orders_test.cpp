// Orders of faults in words, as tendril-plant takes them: command line, scenario, and LCM in the same
// process. Knows no master.
#include "tendril/rig/fault_orders.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <tendril_lcm/event_t.hpp>

#include "tendril/can/memory_bus.h"
#include "tendril/config/config.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"

namespace tendril::rig {
namespace {

using ::testing::ElementsAre;
using ::testing::StartsWith;

class FaultOrders : public ::testing::Test {
 protected:
  FaultOrders() { faults_.Attach(rack_); }

  static std::vector<emulator::EmulatedDriveParameters> Drives() {
    std::vector<emulator::EmulatedDriveParameters> drives(2);
    drives[0].node_id = 3;
    drives[1].node_id = 5;
    return drives;
  }
  void Poll() {
    faults_.Poll(clock_.Now());
    rack_.Poll(clock_.Now());
  }
  /// Identifiers on the bus since the last call.
  std::vector<std::uint32_t> Seen() {
    std::vector<std::uint32_t> ids;
    std::array<can::StampedFrame, 64> got;
    const int n = port_.Receive(got);
    for (int i = 0; i < n; ++i) ids.push_back(got[static_cast<std::size_t>(i)].frame.id);
    return ids;
  }

  SimulatedClock clock_{kNsPerS};
  can::MemoryBus bus_{clock_};
  emulator::FaultInjector faults_{bus_.AddPort(), 1};
  emulator::DriveRack rack_{Drives(), faults_};
  can::CanPort& port_ = bus_.AddPort();
};

TEST_F(FaultOrders, OfTheCommandLineAreDueFromTheStartOn) {
  Order(ReadFaults({"drop cob_id=0x703", "reboot node=5 at_s=0.1"}), faults_, clock_.Now());
  Poll();
  EXPECT_THAT(Seen(), ElementsAre(0x705)) << "the boot-up of node 3 was dropped";
  clock_.Advance(99 * kNsPerMs);
  Poll();
  EXPECT_THAT(Seen(), ElementsAre());
  clock_.Advance(kNsPerMs);
  Poll();
  EXPECT_THAT(Seen(), ElementsAre(0x705)) << "rebooted";
}

TEST_F(FaultOrders, ForANodeThatIsNotThereAreRefusedWithTheirPlace) {
  const auto refusal = [&](const std::vector<FaultOrder>& orders) -> std::string {
    try {
      Order(orders, faults_, clock_.Now());
    } catch (const config::ConfigError& e) {
      return e.what();
    }
    return "(accepted)";
  };
  EXPECT_EQ(refusal(ReadFaults({"die node=4"})),
            "--fault: node 4 is none of the emulated drives; accepted: 3 5; correct the node");
  const std::string path = ::testing::TempDir() + "faults_of_no_node.yaml";
  std::ofstream(path) << "faults:\n  - {fault: reboot, node: 3}\n  - {fault: reboot, node: 1}\n";
  EXPECT_THAT(refusal(ReadScenario(path)), StartsWith(path + ": faults[2]: node 1 is none"));
}

TEST_F(FaultOrders, ByLcmCountFromTheirArrival) {
  const auto lcm = io::OpenLcm("memq://");
  FaultListener listener(*lcm, "TENDRIL", faults_, clock_);
  std::vector<std::string> answers;
  const auto hear = [&answers](const tendril_lcm::event_t& event) {
    if (event.source == "plant") answers.push_back(event.text);
  };
  io::Client client(lcm.get(), "TENDRIL");
  client.OnEvent(hear);
  Poll();
  Seen();
  clock_.Advance(kNsPerS);
  tendril_lcm::fault_t message{};
  message.fault = "reboot node=3 at_s=0.05";
  lcm->publish("TENDRIL_FAULT", &message);
  message.fault = "reboot node=300";
  lcm->publish("TENDRIL_FAULT", &message);
  while (io::HandleWaiting(*lcm, 0) > 0) {
  }
  EXPECT_EQ(listener.ordered(), 1);
  EXPECT_THAT(listener.TakeLines(),
              ElementsAre("fault ordered: reboot node=3 at_s=0.05",
                          StartsWith("fault refused: TENDRIL_FAULT: node: 300 is out of range")));
  EXPECT_THAT(listener.TakeLines(), ElementsAre());
  EXPECT_THAT(answers, ElementsAre("fault ordered: reboot node=3 at_s=0.05", StartsWith("fault refused: ")))
      << "who ordered hears what became of it";
  Poll();
  EXPECT_THAT(Seen(), ElementsAre());
  clock_.Advance(50 * kNsPerMs);
  Poll();
  EXPECT_THAT(Seen(), ElementsAre(0x703));
}

}  // namespace
}  // namespace tendril::rig
