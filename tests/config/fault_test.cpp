// Scenarios and single faults: what is read, and what is refused with file, line and key.
// Knows no drive.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(Fault, OneLineHoldsWhatAScenarioHolds) {
  const FaultParameters p = ParseFault(
      "delay node=2 at_s=1.5 for_s=3 direction=from_drives cob_id=0x182 probability=0.25 count=7 "
      "delay_s=0.01",
      "--fault");
  EXPECT_EQ(p.kind, FaultKind::kDelay);
  EXPECT_EQ(p.node, 2);
  EXPECT_EQ(p.at_s, 1.5);
  EXPECT_EQ(p.for_s, 3);
  EXPECT_EQ(p.direction, FrameDirection::kFromDrives);
  EXPECT_EQ(p.cob_id, 0x182u);
  EXPECT_EQ(p.probability, 0.25);
  EXPECT_EQ(p.count, 7);
  EXPECT_EQ(p.delay_s, 0.01);

  const FaultParameters all = ParseFault("drop", "--fault");
  EXPECT_EQ(all.probability, 1);
  EXPECT_EQ(all.node, 0);
  EXPECT_FALSE(all.cob_id);
  EXPECT_EQ(ParseFault("sto node=2 for_s=1", "").node, 2);
  EXPECT_EQ(ParseFault("sto", "").kind, FaultKind::kSto) << "of every drive";
  EXPECT_EQ(ParseFault("emcy node=3 code=0x7320", "").code, 0x7320);
  EXPECT_EQ(ParseFault(" stick_sensor\tsensor=load_cell node=1", "").sensor, DriveSensor::kLoadCell);
}

TEST(Fault, AnInvalidLineListsTheValidOnes) {
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      (void)ParseFault(text, "--fault");
    } catch (const ConfigError& e) {
      EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << e.what();
      return e.what();
    }
    return "(accepted)";
  };
  EXPECT_THAT(refusal(""), StartsWith("--fault: is empty; accepted: a kind, then key=value"));
  EXPECT_THAT(refusal("node=2 drop"), StartsWith("--fault: 'node=2' is not understood"));
  EXPECT_THAT(refusal("drop node"), StartsWith("--fault: 'node' is not understood"));
  EXPECT_THAT(refusal("explode"),
              AllOf(StartsWith("--fault: fault: 'explode' is not known"), HasSubstr("reboot")));
  EXPECT_THAT(refusal("drop nod=2"),
              AllOf(StartsWith("--fault: nod: unknown key"), HasSubstr("did you mean node?")));
  EXPECT_THAT(refusal("drop node=200"),
              HasSubstr("node: 200 is out of range; accepted: whole number 1 .. 127"));
  EXPECT_THAT(refusal("drop probability=0"), HasSubstr("accepted: above 0 up to 1"));
  EXPECT_THAT(refusal("drop node=1 node=2"), HasSubstr("given twice"));
  EXPECT_THAT(refusal("drop count=0"), HasSubstr("count: 0 is out of range"));
  EXPECT_THAT(refusal("drop node="), HasSubstr("node: has no value"));
  EXPECT_THAT(refusal("die"), HasSubstr("node: missing"));
  EXPECT_THAT(refusal("delay node=1"), HasSubstr("delay_s: missing"));
  EXPECT_THAT(refusal("reboot node=1 probability=0.5"), HasSubstr("probability: unknown key"));
  EXPECT_THAT(refusal("bus_off node=1"), HasSubstr("node: unknown key"));
  EXPECT_THAT(refusal("emcy node=1 code=70000"), HasSubstr("code: 70000 is out of range"));
  EXPECT_THAT(refusal("drop at_s=nan"), HasSubstr("not finite"));
  for (const char* text :
       {"drop {node: 1}", "drop node=[1]", "drop node=\"1\"", "drop node=&a", "drop # x", "drop,node: 1",
        "drop node=1\x01", "drop \xff=1", "{", "drop =", "drop =1", "drop a=b=c"}) {
    EXPECT_THAT(refusal(text), StartsWith("--fault: ")) << text;
  }
}

TEST(Scenario, TheShippedOneLoads) {
  const auto faults = LoadScenario(ConfigPath("scenarios/rough_minute.yaml"));
  ASSERT_EQ(faults.size(), 8u);
  EXPECT_EQ(faults.front().kind, FaultKind::kDrop);
  EXPECT_EQ(faults.back().kind, FaultKind::kBusOff);
  EXPECT_EQ(KindOf(ConfigPath("scenarios/rough_minute.yaml")), "scenario");
}

TEST(Scenario, RefusalsNameFileLineAndKey) {
  const std::string path = ::testing::TempDir() + "scenario.yaml";
  const auto refusal = [&](const std::string& yaml) -> std::string {
    std::ofstream(path) << yaml;
    try {
      (void)LoadScenario(path);
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "(accepted)";
  };
  EXPECT_THAT(refusal("faults:\n  - {fault: drop, node: 1}\n  - {fault: drop, colour: red}\n"),
              StartsWith(path + ":3: faults[2].colour: unknown key"));
  EXPECT_THAT(refusal("faults:\n  - fault: die\n    node: 0\n"),
              StartsWith(path + ":3: faults[1].node: 0 is out of range"));
  EXPECT_THAT(refusal("faults: []\n"), StartsWith(path + ":1: faults: has 0 entries"));
  EXPECT_THAT(refusal("faults:\n  - {at_s: 1, node: 2}\n"),
              StartsWith(path + ":2: faults[1].fault: missing"));
  EXPECT_THAT(refusal("faults:\n  - {fault: reboot, node: 2}\nname: x\n"),
              StartsWith(path + ":3: name: unknown key"));
  EXPECT_THAT(refusal(ReadText(ConfigPath("robots/rig_60mm.yaml"))), HasSubstr("this is a robot file"));
  EXPECT_THAT(refusal("- {fault: drop}\n"), HasSubstr("accepted: a scenario file with faults"));
  std::remove(path.c_str());
}

}  // namespace
}  // namespace tendril::config
