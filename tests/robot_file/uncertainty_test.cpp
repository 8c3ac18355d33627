// Numbers of a robot file that say how well they are known, while effects are written into it: the value
// inside changes, the rest stays, and two robots that differ in nothing else are the same.
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "tendril/config/config.h"
#include "tendril/robot_file/robot_patch.h"

namespace tendril::robot_file {
namespace {

/// The shipped rig's file with uncertainties, written as people do.
std::string UncertainRig() {
  std::ifstream in(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  const auto replace = [&](const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    EXPECT_NE(at, text.npos) << from;
    if (at != text.npos) text.replace(at, from.size(), to);
  };
  replace("youngs_modulus_Pa: 2.3e10 ", "youngs_modulus_Pa: {value: 2.3e10, within: 10 %} ");
  replace("efficiency: 0.84 ", "efficiency: {within: 0.02, value: 0.84} ");
  replace("\nactuation:\n",
          "\nactuation:\n  per_tendon:\n    2:\n      gear:\n        efficiency: {value: 0.8, within: "
          "unknown}\n");
  replace("\nbody:\n",
          "\nbody:\n  unit_deviations:\n    - {unit: 2, stiffness_scale: {value: 1.1, within: 5 %}}\n");
  return text;
}

EffectSetting Effect(std::string name, std::string where, const char* parameter, double value) {
  return {.name = std::move(name), .where = std::move(where), .values = {{parameter, value}}};
}

TEST(Uncertainty, AnEditedNumberKeepsIt) {
  const std::string text = UncertainRig();
  const RobotParameters before = config::ParseRobot(text, "rig.yaml");
  ASSERT_EQ(before.uncertain.size(), 4u);
  const RobotPatch patch = PatchRobot(
      text, "rig.yaml",
      {Effect("bending_stiffness", "all", "scale", 0.5), Effect("gear_efficiency", "all", "scale", 0.5)}, {});
  EXPECT_NE(patch.text.find("youngs_modulus_Pa: {value: 1.15e10, within: 10 %}"), std::string::npos)
      << patch.text;
  EXPECT_NE(patch.text.find("efficiency: {within: 0.02, value: 0.42}"), std::string::npos) << patch.text;
  EXPECT_NE(patch.text.find("efficiency: {value: 0.4, within: unknown}"), std::string::npos) << patch.text;
  EXPECT_EQ(patch.robot.uncertain, before.uncertain);
}

TEST(Uncertainty, ADiskTooSmallForItsHolesGivesWayToItsInertia) {
  std::ifstream in(TENDRIL_SOURCE_DIR "/config/robots/qi2021_90mm.yaml");
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  RobotParameters after = config::ParseRobot(text, "rig.yaml");
  SectionParameters& section = after.body.sections[0];
  section.unit_mass_kg *= 1.25;  // and with it the inertia that follows from the diameter
  section.disk_inertia_xx_kgm2 *= 1.25;
  section.disk_inertia_zz_kgm2 *= 1.25;
  EXPECT_NE(PatchNumbers(text, "rig.yaml", after, {}).text.find("disk_diameter_m: 0.010 "),
            std::string::npos);
  for (TendonRoute& route : section.tendons) route.radius_m = 0.006;
  const RobotPatch patch = PatchNumbers(text, "rig.yaml", after, {});
  EXPECT_EQ(patch.text.find("disk_diameter_m: 0.010 "), std::string::npos) << patch.text;
  EXPECT_EQ(patch.robot.body.sections[0].disk_inertia_zz_kgm2, section.disk_inertia_zz_kgm2);
}

TEST(Uncertainty, StaysInAListThatIsWrittenAnew) {
  const std::string text = UncertainRig();
  const RobotPatch patch =
      PatchRobot(text, "rig.yaml", {Effect("unit_stiffness", "unit:1", "scale", 0.5)}, {});
  ASSERT_EQ(patch.robot.body.unit_deviations.size(), 2u) << patch.text;
  EXPECT_EQ(patch.robot.uncertain.at("body.unit_deviations[2].stiffness_scale"),
            (Uncertainty{Uncertainty::Kind::kShare, 0.05}))
      << patch.text;
}

TEST(Uncertainty, IsNoPartOfWhatARobotIs) {
  const RobotParameters uncertain = config::ParseRobot(UncertainRig(), "rig.yaml");
  RobotParameters plain = uncertain;
  plain.uncertain.clear();
  EXPECT_EQ(RobotDifference(uncertain, plain), 0);
  EXPECT_FALSE(FirstDifference(uncertain, plain).has_value());
  plain.body.sections[0].youngs_modulus_Pa *= 1.01;
  ASSERT_TRUE(FirstDifference(uncertain, plain).has_value());
  EXPECT_EQ(FirstDifference(uncertain, plain)->key, "body.sections[0].youngs_modulus_Pa");
}

}  // namespace
}  // namespace tendril::robot_file
