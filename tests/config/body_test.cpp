// Keys of a body that differs from its drawing: may be left out, come back bit for bit, are refused with
// their line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr const char* kKeys[] = {"tip_payload_kg", "tip_force_W_N", "twist_rad_per_m", "unit_deviations"};

TEST(BodyKeys, ANominalBodyHasAndWritesNone) {
  const RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  EXPECT_EQ(robot.body.tip_payload_kg, 0);
  EXPECT_TRUE(robot.body.tip_force_W_N.isZero(0));
  EXPECT_EQ(robot.body.twist_rad_per_m, 0);
  EXPECT_TRUE(robot.body.unit_deviations.empty());
  for (const char* key : kKeys) EXPECT_THAT(ToYaml(robot), Not(HasSubstr(key)));
}

TEST(BodyKeys, ComeBackBitForBit) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> any(-0.5, 0.5);
  for (int i = 0; i < 30; ++i) {
    RobotParameters robot = LoadRobot(ConfigPath("robots/two_section.yaml"));
    if (any(random) < 0.2) robot.body.tip_payload_kg = 0.01 * (any(random) + 0.5);
    if (any(random) < 0.2) robot.body.tip_force_W_N = {any(random), 0, any(random)};
    if (any(random) < 0.2) robot.body.twist_rad_per_m = 10 * any(random);
    for (int unit = robot.body.units(); unit >= 1; --unit) {
      if (any(random) < 0) continue;
      UnitDeviation& d = robot.body.DeviationOf(unit);
      if (any(random) < 0) d.stiffness_scale = 1 + any(random);
      if (any(random) < 0) d.rest_u_rad = any(random);
      if (any(random) < 0) d.rest_v_rad = any(random);
    }
    const BodyParameters &body = robot.body, again = ParseRobot(ToYaml(robot), "again").body;
    EXPECT_EQ(again.tip_payload_kg, body.tip_payload_kg);
    EXPECT_EQ(again.tip_force_W_N, body.tip_force_W_N);
    EXPECT_EQ(again.twist_rad_per_m, body.twist_rad_per_m);
    ASSERT_EQ(again.unit_deviations.size(), body.unit_deviations.size());
    for (std::size_t k = 0; k < body.unit_deviations.size(); ++k) {
      const UnitDeviation &a = again.unit_deviations[k], &b = body.unit_deviations[k];
      EXPECT_EQ(a.unit, b.unit);
      EXPECT_EQ(a.stiffness_scale, b.stiffness_scale);
      EXPECT_EQ(a.rest_u_rad, b.rest_u_rad);
      EXPECT_EQ(a.rest_v_rad, b.rest_v_rad);
    }
  }
}

TEST(BodyKeys, UnitsMayBeListedInAnyOrder) {
  const std::string yaml =
      Edited(ReadText(ConfigPath("robots/rig_60mm.yaml")), "  sections:",
             "  unit_deviations: [{unit: 3, rest_v_rad: 0.1}, {unit: 1, stiffness_scale: 0.9}]\n  sections:");
  const RobotParameters robot = ParseRobot(yaml, "some.yaml");
  ASSERT_EQ(robot.body.unit_deviations.size(), 2u);
  EXPECT_EQ(robot.body.unit_deviations[0].unit, 1);
  EXPECT_EQ(robot.body.unit_deviations[0].stiffness_scale, 0.9);
  EXPECT_EQ(robot.body.unit_deviations[1].rest_v_rad, 0.1);
  EXPECT_EQ(robot.body.unit_deviations[1].rest_u_rad, 0);
}

TEST(BodyKeys, InvalidValuesAreRefusedWithTheirLine) {
  struct Case {
    const char *given, *key;
    std::vector<const char*> says;
  };
  const Case cases[] = {
      {"tip_payload_kg: -0.001", "body.tip_payload_kg", {"0 .. 1000 kg"}},
      {"twist_rad_per_m: 1900", "body.twist_rad_per_m", {"-1000 .. 1000 rad/m"}},
      {"tip_force_W_N: [0.1, 0.2]", "body.tip_force_W_N", {"2 entries"}},
      {"tip_force_W_N: [0.1, .nan, 0]", "body.tip_force_W_N[2]", {"not finite"}},
      {"unit_deviations: [{stiffness_scale: 0.9}]", "body.unit_deviations[1].unit", {"missing"}},
      {"unit_deviations: [{unit: 0}]", "body.unit_deviations[1].unit", {"1 .. 64"}},
      {"unit_deviations: [{unit: 5}]", "body.unit_deviations", {"unit 5 does not exist", "1 .. 4"}},
      {"unit_deviations: [{unit: 2}, {unit: 2}]", "body.unit_deviations", {"unit 2 twice", "join the two"}},
      {"unit_deviations: [{unit: 2, stiffness_scale: 0}]",
       "body.unit_deviations[1].stiffness_scale",
       {"0.01 .. 100"}},
      {"unit_deviations: [{unit: 2, softness: 1}]", "body.unit_deviations[1].softness", {"unknown key"}},
  };
  for (const Case& c : cases) {
    const std::string yaml = Edited(ReadText(ConfigPath("robots/rig_60mm.yaml")),
                                    "  sections:", std::string("  ") + c.given + "\n  sections:");
    std::string message = "(accepted)";
    try {
      (void)ParseRobot(yaml, "some.yaml");
    } catch (const ConfigError& e) {
      message = e.what();
    }
    EXPECT_THAT(message,
                StartsWith("some.yaml:" + std::to_string(LineWith(yaml, c.given)) + ": " + c.key + ": "));
    EXPECT_THAT(message, HasSubstr("; accepted: "));
    for (const char* part : c.says) EXPECT_THAT(message, HasSubstr(part));
  }
}

}  // namespace
}  // namespace tendril::config
