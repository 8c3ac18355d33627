// Numbers that say how well they are known: each form is read, each mistake is one line with its place, and
// what is written is read again as the same.
#include "tendril/core/uncertainty.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "files.h"
#include "tendril/config/config.h"
#include "tendril/config/keys.h"

namespace tendril::config {
namespace {

using Kind = Uncertainty::Kind;

constexpr const char* kModulus = "body.sections[1].youngs_modulus_Pa";

/// The shipped rig's file with one text replaced.
std::string With(const std::string& old, const std::string& text) {
  return Edited(ReadText(ConfigPath("robots/rig_60mm.yaml")), old, text);
}

std::string WithModulus(const std::string& number) {
  return With("youngs_modulus_Pa: 2.3e10", "youngs_modulus_Pa: " + number);
}

RobotParameters Read(const std::string& yaml) { return ParseRobot(yaml, "f.yaml"); }

std::string RefusalOf(const std::string& yaml) {
  try {
    Read(yaml);
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "accepted";
}

TEST(Uncertainty, EachFormIsRead) {
  const std::vector<std::pair<std::string, Uncertainty>> forms = {
      {"10 %", {Kind::kShare, 0.1}},     {"10%", {Kind::kShare, 0.1}},     {"\"7 %\"", {Kind::kShare, 0.07}},
      {"'2.5%'", {Kind::kShare, 0.025}}, {"3e9", {Kind::kAbsolute, 3e9}},  {"known", {Kind::kKnown, 0}},
      {"unknown", {Kind::kUnknown, 0}},  {"\"known\"", {Kind::kKnown, 0}}, {"1e2 %", {Kind::kShare, 1}},
  };
  for (const auto& [text, uncertainty] : forms) {
    SCOPED_TRACE(text);
    const RobotParameters robot = Read(WithModulus("{value: 2.4e10, within: " + text + "}"));
    EXPECT_EQ(robot.body.sections[0].youngs_modulus_Pa, 2.4e10);
    EXPECT_EQ(robot.uncertain, (std::map<std::string, Uncertainty>{{kModulus, uncertainty}}));
  }
  const RobotParameters block = Read(WithModulus("\n        value: 2.4e10\n        within: 10 %"));
  EXPECT_EQ(block.uncertain.at(kModulus), (Uncertainty{Kind::kShare, 0.1}));
  const RobotParameters alone = Read(WithModulus("{value: 2.4e10}"));
  EXPECT_EQ(alone.body.sections[0].youngs_modulus_Pa, 2.4e10);
  EXPECT_TRUE(alone.uncertain.empty());
  EXPECT_TRUE(LoadRobot(ConfigPath("robots/rig_60mm.yaml")).uncertain.empty());
}

TEST(Uncertainty, OfNumbersInListsIntegersAndTendons) {
  std::string yaml =
      With("gravity_W_mps2: [0.0, 0.0, -9.81]", "gravity_W_mps2: [0, {value: 0, within: 0.1}, -9.81]");
  yaml = Edited(
      yaml, "\nactuation:\n",
      "\nactuation:\n  per_tendon:\n    2: {motor: {torque_constant_NmpA: {value: 0.0195, within: 2 %}}}\n");
  const RobotParameters robot = Read(yaml);
  EXPECT_EQ(robot.uncertain.at("body.gravity_W_mps2[2]"), (Uncertainty{Kind::kAbsolute, 0.1}));
  EXPECT_EQ(robot.uncertain.at("actuation.per_tendon.2.motor.torque_constant_NmpA"),
            (Uncertainty{Kind::kShare, 0.02}));
  EXPECT_EQ(robot.uncertain.size(), 2u);
}

TEST(Uncertainty, ADisksDiameterCountsForItsInertias) {
  const RobotParameters robot =
      Read(With("disk_diameter_m: 0.010", "disk_diameter_m: {value: 0.01, within: 0.0002}"));
  for (const char* key : {"body.sections[1].disk_inertia_xx_kgm2", "body.sections[1].disk_inertia_zz_kgm2"}) {
    EXPECT_EQ(robot.uncertain.at(key).kind, Kind::kShare);
    EXPECT_NEAR(robot.uncertain.at(key).deviation, 0.04, 1e-15);
  }
  EXPECT_EQ(robot.uncertain.size(), 2u);
}

TEST(Uncertainty, EachMistakeIsOneLineWithItsPlace) {
  const std::string yaml = ReadText(ConfigPath("robots/rig_60mm.yaml"));
  const std::string
      place = "f.yaml:" + std::to_string(LineWith(yaml, "youngs_modulus_Pa")) + ": " + kModulus,
      accepted =
          "; accepted: one standard deviation as a share (10 %) or a number in Pa, or known, or "
          "unknown; ";
  const std::vector<std::pair<std::string, std::string>> mistakes = {
      {"{within: 10 %}",
       ".value: missing; accepted: 1000000 .. 1000000000000 Pa; add it below " + std::string(kModulus)},
      {"{value: 2.3e10, withn: 10 %}", ".withn: unknown key; accepted: value, within; did you mean within?"},
      {"{value: 2.3e10, within: 10 %, unit: Pa}",
       ".unit: unknown key; accepted: value, within; remove it or correct its place"},
      {"{value: 2.3e10, value: 2.3e10}", ".value: given twice"},
      {"{value: 23, within: 10 %}", ".value: 23 is out of range; accepted: 1000000 .. 1000000000000 Pa; "},
      {"{value: [1], within: 10 %}",
       ".value: is a list, not a number; accepted: 1000000 .. 1000000000000 Pa; "},
      {"{value: 2.3e10, within: }", ".within: has no value; "},
      {"{value: 2.3e10, within: about a tenth}",
       ".within: 'about a tenth' is not understood" + accepted + "write one of these"},
      {"{value: 2.3e10, within: [1]}", ".within: is a list" + accepted + "write one of these"},
      {"{value: 2.3e10, within: \"3e9\"}",
       ".within: is text in quotes" + accepted + "remove the quotes, or write a percent sign in them"},
      {"{value: 2.3e10, within: 0 %}", ".within: '0 %' is no share above 0 up to 1000 %" + accepted +
                                           "correct it, or write known or unknown"},
      {"{value: 2.3e10, within: -5 %}", ".within: '-5 %' is no share"},
      {"{value: 2.3e10, within: nan %}", ".within: 'nan %' is no share"},
      {"{value: 2.3e10, within: 0}", ".within: 0 is no standard deviation" + accepted +
                                         "write a number above 0, or known for an exact value"},
      {"{value: 2.3e10, within: -1e9}", ".within: -1e9 is no standard deviation"},
      {"{value: 2.3e10, within: .inf}", ".within: '.inf' is not understood"},
      {"{value: 2.3e10, within: 0.1}", ".within: 0.1 is next to nothing of 2.3e+10" + accepted +
                                           "for a share write it with a percent sign, as in 10 %"},
      {"{value: 2.3e10, within: 1e13}", ".within: 1e13 is more than the whole range of the value"},
  };
  for (const auto& [number, wanted] : mistakes) {
    const std::string refusal = RefusalOf(WithModulus(number));
    EXPECT_TRUE(refusal.starts_with(place + wanted))
        << number << "\n  " << refusal << "\n  " << place << wanted;
    EXPECT_EQ(refusal.find('\n'), refusal.npos);
  }
  EXPECT_NE(RefusalOf(With("gravity_W_mps2: [0.0,", "gravity_W_mps2: [{value: 0, within: 10 %},"))
                .find("body.gravity_W_mps2[1].within: 10 % of 0 is nothing; accepted: one standard deviation "
                      "as a share "
                      "(10 %) or a number in m/s², or known, or unknown; give the deviation in m/s²"),
            std::string::npos);
  EXPECT_NE(RefusalOf(With("gravity_W_mps2: [0.0, 0.0, -9.81]",
                           "gravity_W_mps2: {value: [0, 0, -9.81], within: 1 %}"))
                .find("body.gravity_W_mps2: is a mapping, not a list; accepted: a list of 3 numbers"),
            std::string::npos);
}

TEST(Uncertainty, DaemonAndScenarioFilesDoNotTakeIt) {
  std::string daemon = ReadText(ConfigPath("tendrild.yaml"));
  const std::size_t at = daemon.find("max_following_error_m: "), end = daemon.find('\n', at);
  daemon.replace(at, end - at, "max_following_error_m: {value: 0.004, within: 10 %}");
  try {
    ParseDaemon(daemon, "d.yaml");
    FAIL() << "accepted";
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string(e.what()).find("max_following_error_m: is a mapping, not a number; accepted:"),
              std::string::npos)
        << e.what();
  }
}

void ExpectReadAgain(const RobotParameters& robot) {
  const std::string yaml = ToYaml(robot);
  const RobotParameters again = Read(yaml);
  EXPECT_EQ(again.uncertain, robot.uncertain) << yaml;
  EXPECT_EQ(ToYaml(again), yaml);
  RobotParameters plain = robot, plain_again = again;
  plain.uncertain.clear();
  plain_again.uncertain.clear();
  EXPECT_EQ(ToYaml(plain_again), ToYaml(plain));
}

TEST(Uncertainty, RoundTrip) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> share(1e-4, 0.6);
  for (int i = 0; i < 5; ++i) {
    RobotParameters robot = LoadRobot(ConfigPath("robots/rig_60mm.yaml"));
    robot.body.unit_deviations = {{.unit = 2, .rest_u_rad = 0.01}};
    robot.effects = {{"backlash", "tendon:2", {{"rad", 0.1}}}};
    robot.uncertain = {
        {kModulus, {Kind::kShare, share(random)}},
        {"body.gravity_W_mps2[1]", {Kind::kAbsolute, share(random)}},
        {"body.sections[1].units", {Kind::kKnown, 0}},
        {"body.sections[1].tendons[2].angle_rad", {Kind::kAbsolute, share(random)}},
        {"body.unit_deviations[1].rest_u_rad", {Kind::kUnknown, 0}},
        {"limits.max_tension_base_N", {Kind::kShare, share(random)}},
        {"actuation.motor.torque_constant_NmpA", {Kind::kShare, share(random)}},
        {"actuation.gear.presliding_yields_rad[1]", {Kind::kShare, share(random)}},
        {"actuation.per_tendon.3.motor.torque_constant_NmpA", {Kind::kShare, share(random)}},
        {"actuation.tracker.delay_s", {Kind::kAbsolute, share(random)}},
        {"effects[1].rad", {Kind::kShare, share(random)}},
    };
    ExpectReadAgain(robot);
    // A tendon's own uncertainty of a value that all share, and all tendons written apart.
    robot.uncertain["actuation.per_tendon.1.tendon.stiffness_Npm"] = {Kind::kShare, share(random)};
    for (auto& tendon : robot.actuation.value().tendons) tendon.tendon.stiffness_Npm *= 1 + share(random);
    ExpectReadAgain(robot);
  }
}

TEST(Uncertainty, StaysWithItsUnitWhereUnitsAreSorted) {
  const RobotParameters robot =
      Read(With("body:\n",
                "body:\n  unit_deviations:\n    - {unit: 3, rest_u_rad: {value: 0.03, within: 5 %}}\n"
                "    - {unit: 1, rest_u_rad: {value: 0.01, within: 0.001}}\n"));
  ASSERT_EQ(robot.body.unit_deviations[0].unit, 1);
  EXPECT_EQ(robot.uncertain.at("body.unit_deviations[1].rest_u_rad"), (Uncertainty{Kind::kAbsolute, 0.001}));
  EXPECT_EQ(robot.uncertain.at("body.unit_deviations[2].rest_u_rad"), (Uncertainty{Kind::kShare, 0.05}));
  ExpectReadAgain(robot);
}

TEST(Uncertainty, TextsReadBackBitForBit) {
  EXPECT_EQ(UncertaintyText({Kind::kShare, 0.1}), "10 %");
  EXPECT_EQ(UncertaintyText({Kind::kShare, 0.07}), "7 %");
  EXPECT_EQ(UncertaintyText({Kind::kShare, 1}), "100 %");
  EXPECT_EQ(UncertaintyText({Kind::kShare, 0.0004}), "0.04 %");
  EXPECT_EQ(UncertaintyText({Kind::kShare, 0.123456}), "12.3456 %");
  EXPECT_EQ(UncertaintyText({Kind::kAbsolute, 2e-5}), "2e-05");
  EXPECT_EQ(UncertaintyText({Kind::kKnown, 0}), "known");
  EXPECT_EQ(UncertaintyText({Kind::kUnknown, 0}), "unknown");
}

/// What is usual of every number that a robot file may have, by its key without blocks where that is enough:
/// a new key has no place here until somebody thought of it.
TEST(Uncertainty, EachNumberHasItsUsualOne) {
  const auto share = [](double percent) { return Uncertainty{Kind::kShare, percent / 100}; };
  const Uncertainty known{Kind::kKnown, 0}, two_degrees{Kind::kAbsolute, 2 * std::numbers::pi / 180};
  const std::map<std::string, Uncertainty> usual = {
      {"youngs_modulus_Pa", share(15)},
      {"unit_length_m", share(2)},
      {"free_length_m", share(2)},
      {"disk_diameter_m", share(2)},
      {"core_radius_m", share(5)},
      {"tendons[].radius_m", share(5)},
      {"spool.radius_m", share(2)},
      {"tendons[].angle_rad", two_degrees},
      {"entry_angle_rad", two_degrees},
      {"unit_mass_kg", share(20)},
      {"tip_payload_kg", share(20)},
      {"tip_force_W_N", share(20)},
      {"disk_inertia_xx_kgm2", share(20)},
      {"disk_inertia_zz_kgm2", share(20)},
      {"bending_damping_Nms", share(40)},
      {"stiffness_scale", share(5)},
      {"rest_u_rad", {Kind::kAbsolute, std::numbers::pi / 180}},
      {"rest_v_rad", {Kind::kAbsolute, std::numbers::pi / 180}},
      {"twist_rad_per_m", {Kind::kAbsolute, 0.5}},
      {"torque_constant_NmpA", share(4)},
      {"rotor_inertia_kgm2", share(10)},
      {"coulomb_friction_Nm", share(40)},
      {"coulomb_angle_rad", share(40)},
      {"coulomb_damping_Nms", share(40)},
      {"viscous_friction_Nms", share(40)},
      {"torque_lag_s", share(40)},
      {"efficiency", share(10)},
      {"presliding_yields_rad", share(40)},
      {"stiffness_Npm", share(20)},
      {"damping_Nspm", share(40)},
      {"wrap_rad", share(5)},
      {"radius_ratio", share(5)},
      {"alpha", share(40)},
      {"exponent", share(5)},
      {"presliding_m", share(40)},
      {"coulomb_N", share(40)},
      {"pretension_N", share(20)},
      {"pairs[].tendons", known},
      {"gain_VpN", share(5)},
      {"offset_N", {Kind::kAbsolute, 0.1}},
      {"delay_s", share(40)},
      {"end_radius_m", share(5)},
      {"turn_rad_per_m", {Kind::kAbsolute, 0.5}},
      {"disk_mass_kg", share(20)},
      {"poissons_ratio", share(10)},
      {"torsional_stiffness_Nm2", share(15)},
      {"axial_stiffness_N", share(15)},
      {"shear_stiffness_N", share(15)},
      {"torsional_damping_Nms", share(40)},
      {"axial_damping_Nspm", share(40)},
      {"shear_damping_Nspm", share(40)},
      {"rest_torsion_rad_per_m", {Kind::kAbsolute, 0.5}},
      {"rest_extension", {Kind::kAbsolute, 0.005}},
      {"units_per_disk", known},
      {"ends_at_disk", known},
      {"units", known},
      {"unit", known},
      {"gravity_W_mps2", known},
      {"nominal_current_A", known},
      {"torque_scale", known},
      {"rated_torque_Nm", known},
      {"current_limit_A", known},
      {"encoder_counts_per_turn", known},
      {"actual_torque_noise_permille", known},
      {"gear.ratio", known},
      {"low_tension_N", known},
      {"resolution_V", known},
      {"noise_N", known},
      {"rate_Hz", known},
      {"position_noise_m", known},
      {"orientation_noise_rad", known},
      {"nodes", known},
      {"min_tension_N", known},
      {"max_tension_base_N", known},
      {"max_tension_motor_N", known},
      {"max_bending_rad", known},
  };
  std::size_t seen = 0;
  for (const Key& key : RobotFileKeys()) {
    if (key.kind != Key::Kind::kValue || (key.type != Key::Type::kNumber && key.type != Key::Type::kInteger))
      continue;
    const auto row = std::find_if(usual.begin(), usual.end(), [&](const auto& u) {
      return key.path == u.first || key.path.ends_with("." + u.first);
    });
    ASSERT_NE(row, usual.end()) << key.path;
    EXPECT_EQ(UsualUncertainty(key.path), row->second) << key.path;
    ++seen;
  }
  EXPECT_EQ(seen, usual.size());
  EXPECT_EQ(UsualUncertainty("body.sections[1].tendons[2].radius_m"), share(5));
  EXPECT_EQ(UsualUncertainty("actuation.per_tendon.2.spool.radius_m"), share(2));
  EXPECT_EQ(UsualUncertainty("actuation.gear.presliding_yields_rad[2]"), share(40));
  EXPECT_EQ(UsualUncertainty("effects[1].rad").kind, Kind::kUnknown);
}

}  // namespace
}  // namespace tendril::config
