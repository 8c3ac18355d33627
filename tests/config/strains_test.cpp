// Keys of sections that twist and stretch: may be left out, come back bit for bit, are refused with their
// line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "files.h"
#include "tendril/config/config.h"

namespace tendril::config {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

const std::string kRod = "robots/rod_5disks.yaml";

std::string WhyRefused(const std::string& yaml) {
  try {
    ParseRobot(yaml, "rod.yaml");
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "accepted";
}

TEST(Strains, ABodyThatOnlyBendsHasAndWritesNone) {
  const RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
  EXPECT_TRUE(robot.body.BendsOnly());
  for (const char* key : {"strains", "units_per_disk", "disk_mass_kg", "poissons_ratio", "torsional", "axial",
                          "shear", "rest_"})
    EXPECT_THAT(ToYaml(robot), Not(HasSubstr(key)));
}

TEST(Strains, TheShippedRodIsThePapersWireBetweenFiveDisks) {
  const RobotParameters robot = LoadRobot(ConfigPath(kRod));
  const SectionParameters& s = robot.body.sections.front();
  EXPECT_TRUE(s.torsion && s.extension && s.shear);
  EXPECT_DOUBLE_EQ(robot.body.length_m(), 0.09);
  EXPECT_EQ(s.units / s.units_per_disk, 5);
  EXPECT_NEAR(robot.body.mass_kg(), 5 * 0.002 + 10 * 4.56e-5, 1e-15);
  // Textbook values of a round rod of 1 mm: G J = 8.684e-4 N·m², E A = 18064 N.
  EXPECT_NEAR(s.UnitTorsionalStiffness() * s.unit_length_m, 2.3e10 / 2.6 * 9.817477e-14, 1e-9);
  EXPECT_NEAR(s.UnitAxialStiffness() / s.unit_length_m, 2.3e10 * 7.853982e-7, 1e-2);
  // k G A = 0.8864 of 6947.7 N, and the bending that one constant bend leaves out.
  const double bending_Nm2 = 2.3e10 * std::numbers::pi * 6.25e-14 / 4;
  EXPECT_NEAR(s.UnitShearStiffness(), 0.009 / (1 / 6158.2 + 0.009 * 0.009 / 12 / bending_Nm2), 1e-6);
  EXPECT_DOUBLE_EQ(s.disk_inertia_zz_kgm2, 0.002 * 0.01 * 0.01 / 8);
}

TEST(Strains, ComeBackBitForBit) {
  RobotParameters robot = LoadRobot(ConfigPath(kRod));
  SectionParameters& s = robot.body.sections.front();
  s.poissons_ratio.reset();
  s.torsional_stiffness_Nm2 = 1.0 / 3e3;
  s.axial_stiffness_N = 1e4 / 3;
  s.torsional_damping_Nms = 1e-6 / 3;
  s.axial_damping_Nspm = 2.0 / 3;
  s.rest_torsion_rad_per_m = -1.0 / 3;
  s.rest_extension = 1.0 / 30;
  s.shear_stiffness_N = 2e4 / 3;
  s.shear_damping_Nspm = 1.0 / 7;
  for (const bool extension : {true, false}) {
    if (!extension) {
      s.extension = s.shear = false;
      s.axial_stiffness_N.reset();
      s.shear_stiffness_N.reset();
      s.axial_damping_Nspm = s.shear_damping_Nspm = s.rest_extension = 0;
    }
    const SectionParameters again = ParseRobot(ToYaml(robot), "again").body.sections.front();
    EXPECT_EQ(again.torsion, true);
    EXPECT_EQ(again.extension, extension);
    EXPECT_EQ(again.units_per_disk, 2);
    EXPECT_EQ(again.disk_mass_kg, s.disk_mass_kg);
    EXPECT_EQ(again.poissons_ratio, s.poissons_ratio);
    EXPECT_EQ(again.torsional_stiffness_Nm2, s.torsional_stiffness_Nm2);
    EXPECT_EQ(again.axial_stiffness_N, s.axial_stiffness_N);
    EXPECT_EQ(again.torsional_damping_Nms, s.torsional_damping_Nms);
    EXPECT_EQ(again.axial_damping_Nspm, s.axial_damping_Nspm);
    EXPECT_EQ(again.rest_torsion_rad_per_m, s.rest_torsion_rad_per_m);
    EXPECT_EQ(again.rest_extension, s.rest_extension);
    EXPECT_EQ(again.shear, extension);
    EXPECT_EQ(again.shear_stiffness_N, s.shear_stiffness_N);
    EXPECT_EQ(again.shear_damping_Nspm, s.shear_damping_Nspm);
  }
}

TEST(Strains, WhatMakesNoSenseIsRefusedWithItsLineKeyAndRange) {
  const std::string rod = ReadText(ConfigPath(kRod)),
                    strains = "strains: [bending, torsion, extension, shear]";
  const std::string ratio = "poissons_ratio: 0.3 ";
  const auto refused = [&](const std::string& from, const std::string& to, const std::string& key,
                           const std::string& accepted) {
    const std::string yaml = Edited(rod, from, to);
    const std::string line = std::to_string(LineWith(yaml, key + ":"));
    EXPECT_THAT(WhyRefused(yaml), AllOf(StartsWith("rod.yaml:" + line + ": body.sections[1]." + key),
                                       HasSubstr("accepted: " + accepted)));
  };
  refused("units_per_disk: 2", "units_per_disk: 0", "units_per_disk", "");
  refused("units_per_disk: 2", "units_per_disk: 3", "units_per_disk", "a divisor of units");
  refused(ratio, "", "strains", "torsion beside poissons_ratio (-0.99 .. 0.5)");
  refused(ratio, "poissons_ratio: 0.6 ", "poissons_ratio", "-0.99 .. 0.5");
  EXPECT_EQ(WhyRefused(Edited(rod, ratio, "poissons_ratio: 0.3\n      torsional_stiffness_Nm2: 1e-3 ")),
            "accepted");
  refused(ratio, "poissons_ratio: 0.3\n      torsional_stiffness_Nm2: 1e-3\n      shear_stiffness_N: 6e3 ",
          "poissons_ratio", "one of the two");
  refused(ratio, "torsional_stiffness_Nm2: 1e-3 ", "strains", "shear beside poissons_ratio (-0.99 .. 0.5)");
  refused(ratio, "poissons_ratio: 0.3\n      shear_stiffness_N: 0 ", "shear_stiffness_N", "0.001 .. ");
  refused(ratio, "shear_stiffness_N: 6e3\n      torsional_stiffness_Nm2: -1 ", "torsional_stiffness_Nm2",
          "1e-12 .. 1000000 N·m²");
  refused(ratio, "poissons_ratio: 0.3\n      axial_stiffness_N: 0 ", "axial_stiffness_N", "0.001 .. ");
  refused(ratio, "poissons_ratio: 0.3\n      axial_damping_Nspm: -1 ", "axial_damping_Nspm", "0 .. ");
  refused(ratio, "poissons_ratio: 0.3\n      rest_extension: -1 ", "rest_extension", "-0.5 .. 1");
  refused(strains, "strains: [torsion, extension]", "strains", "bending");
  refused(strains, "strains: [bending, warping]", "strains", "bending, torsion, extension, shear");
  refused(strains, "strains: [bending, bending]", "strains", "bending, torsion, extension");
  refused(strains, "strains: bending", "strains", "");
  refused(strains, "strains: [bending, extension]", "poissons_ratio",
          "only where strains names torsion or shear");
}

TEST(TendonRoutes, ComeBackBitForBitAndAreRefusedWithTheirLine) {
  const std::string rod = ReadText(ConfigPath(kRod)), first = "{angle_rad: 0.0, radius_m: 0.004}";
  const auto with = [&](const std::string& keys) {
    return Edited(rod, first, "{angle_rad: 0.0, radius_m: 0.004, " + keys + "}");
  };
  const RobotParameters robot =
      ParseRobot(with("end_radius_m: 0.003, turn_rad_per_m: -12.5, ends_at_disk: 3"), "rod.yaml");
  for (const RobotParameters& read : {robot, ParseRobot(ToYaml(robot), "again")}) {
    const TendonRoute& t = read.body.sections[0].tendons[0];
    EXPECT_EQ(t.end_radius_m, 0.003);
    EXPECT_EQ(t.turn_rad_per_m, -12.5);
    EXPECT_EQ(t.ends_at_disk, 3);
    EXPECT_TRUE(read.body.sections[0].tendons[1].IsStraight());
  }
  EXPECT_THAT(ToYaml(ParseRobot(rod, "rod.yaml")), Not(HasSubstr("ends_at_disk")));
  EXPECT_THAT(WhyRefused(with("ends_at_disk: 6")), HasSubstr("accepted: 1 .. 5"));
  EXPECT_THAT(WhyRefused(with("ends_at_disk: 0")), HasSubstr("ends_at_disk"));
  EXPECT_THAT(WhyRefused(with("end_radius_m: 0.0004")),
              HasSubstr("does not leave room for the hole of tendon 1"));
  EXPECT_THAT(WhyRefused(with("end_radius_m: 0.006")), HasSubstr("disk_diameter_m"));
}

TEST(Strains, WhatKnowsBendingAloneSaysSo) {
  const std::string path = ConfigPath(kRod);
  const auto refusal = [](const std::string& file) -> std::string {
    try {
      RequireBendingOnly(LoadRobot(file).body, file, "tendril model ik");
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "accepted";
  };
  EXPECT_THAT(refusal(path), AllOf(HasSubstr(":" + std::to_string(LineWith(ReadText(path), "strains:")) +
                                             ": body.sections[1].strains: torsion, extension, shear"),
                                   HasSubstr("accepted: [bending]")));
  EXPECT_EQ(refusal(ConfigPath("robots/two_section.yaml")), "accepted");
}

}  // namespace
}  // namespace tendril::config
