// `tendril gap apply`, `gap explain` and `gap report` as a user runs them: the new robot file contains the
// finding and its source, and nothing is written for a finding that is not established.
#include <nlohmann/json.hpp>

#include "cli.h"
#include "report_examples.h"
#include "tendril/config/config.h"
#include "tendril/gap/report.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using gap::Diagnosis;
using gap::Verdict;
using nlohmann::json;
using testing::HasSubstr;

class ApplyCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    CommandTest::SetUp();
    fs::copy_file(kRig, folder_ / "rig.yaml");
    rig_ = ReadText(kRig);
  }
  /// A report that accepted these causes.
  Diagnosis Report(Verdict verdict, std::vector<gap::Cause> causes, const std::string& file = "report.json") {
    Diagnosis d = gap::ExampleDiagnosis(verdict);
    d.robot_name = config::LoadRobot(kRig).name;
    d.robot_yaml = config::ToYaml(config::LoadRobot(kRig));
    d.accepted = std::move(causes);
    WriteText(folder_ / file, gap::ReportJson(d));
    return d;
  }
  static gap::Cause Cause(const std::string& effect, const std::string& where, const std::string& parameter,
                          gap::Estimate value) {
    gap::Cause cause;
    cause.effect = effect;
    cause.where = where;
    cause.p = 0.97;
    cause.parameters[parameter] = value;
    return cause;
  }
  int Apply(const std::string& arguments) { return Run("gap apply --robot rig.yaml " + arguments); }

  std::string rig_;
};

TEST_F(ApplyCommandTest, TheFindingIsInTheNewFileWithWhereItComesFrom) {
  const Diagnosis d =
      Report(Verdict::kAttributed, {Cause("bending_stiffness", "all", "scale", {0.9214837, 0.90, 0.94}),
                                    Cause("backlash", "tendon:2", "rad", {0.05123456, 0.05, 0.0525})});
  ASSERT_EQ(Apply("report.json --out new.yaml"), 0) << error_;
  const RobotParameters before = sim::LoadRobot(kRig), after = sim::LoadRobot(folder_ / "new.yaml");
  // As many digits as the interval justifies.
  EXPECT_NEAR(after.body.sections[0].youngs_modulus_Pa / before.body.sections[0].youngs_modulus_Pa, 0.9215,
              1e-9);
  ASSERT_EQ(after.effects.size(), 1u);
  EXPECT_EQ(after.effects[0].where, "tendon:2");
  EXPECT_NEAR(after.effects[0].values[0].second, 0.05123, 1e-5);
  const std::string text = ReadText(folder_ / "new.yaml");
  for (const std::string& word :
       {std::string("report.json"), std::string("attributed"),
        std::string("bending_stiffness all (p = 0.97), scale"), "sha256 " + d.runs[0].sha256, d.version}) {
    EXPECT_THAT(text.substr(0, text.find("name:")), HasSubstr(word));
  }
  EXPECT_THAT(out_, HasSubstr("1 applied to its numbers (used by the controller), 1 added as laws"));
  EXPECT_THAT(out_, testing::ContainsRegex("\n- .*youngs_modulus_Pa"));
  EXPECT_EQ(ReadText(folder_ / "rig.yaml"), rig_);
  EXPECT_EQ(Run("config check new.yaml"), 0) << error_;
}

TEST_F(ApplyCommandTest, NumbersLearnedAreAppliedWithTheCauseOrAlone) {
  for (const Verdict verdict : {Verdict::kAttributed, Verdict::kNoGap}) {
    const bool cause = verdict == Verdict::kAttributed;
    Diagnosis d =
        Report(verdict, cause ? std::vector{Cause("backlash", "tendon:2", "rad", {0.05, 0.04, 0.06})}
                              : std::vector<gap::Cause>());
    d.learned = {{"body.sections.unit_mass_kg", 0.0025, 0.0021, -0.9},
                 {"body.sections.tendons (tendon 2) radius_m", 0.004, 0.0041, 0.5}};
    WriteText(folder_ / "report.json", gap::ReportJson(d));
    ASSERT_EQ(Apply("report.json --overwrite --out new.yaml"), 0) << error_;
    const RobotParameters after = sim::LoadRobot(folder_ / "new.yaml");
    EXPECT_NEAR(after.body.sections[0].unit_mass_kg, 0.0021, 1e-12);
    EXPECT_NEAR(after.body.sections[0].tendons[1].radius_m, 0.0041, 1e-12);
    EXPECT_EQ(after.body.sections[0].tendons[0].radius_m, 0.004);
    EXPECT_EQ(after.effects.size(), cause ? 1u : 0u);
    EXPECT_THAT(ReadText(folder_ / "new.yaml"),
                HasSubstr("learned body.sections.unit_mass_kg: 0.0021, was 0.0025"));
  }
}

TEST_F(ApplyCommandTest, OnlyWhatIsEstablishedIsApplied) {
  for (const Verdict verdict :
       {Verdict::kNoGap, Verdict::kAmbiguousGroup, Verdict::kUnexplained, Verdict::kInsufficientData}) {
    Report(verdict, {Cause("bending_stiffness", "all", "scale", {0.92, 0.91, 0.93})});
    EXPECT_EQ(Apply("report.json --out new.yaml"), 1);
    EXPECT_THAT(error_, HasSubstr("the verdict is " + gap::VerdictName(verdict)));
    EXPECT_EQ(verdict == Verdict::kNoGap, error_.find("nothing to apply") != std::string::npos) << error_;
    EXPECT_TRUE(OneLine());
    EXPECT_FALSE(fs::exists(folder_ / "new.yaml"));
  }
  EXPECT_EQ(Apply("report.json --out new.yaml --force"), 0) << error_;
  Report(Verdict::kAttributed, {});
  EXPECT_EQ(Apply("report.json --out other.yaml"), 1);
  EXPECT_THAT(error_, HasSubstr("nothing to apply"));
}

TEST_F(ApplyCommandTest, InvalidInputIsRefusedAndNothingWritten) {
  const struct {
    gap::Cause cause;
    const char* says;
  } causes[] = {
      {Cause("gremlins", "all", "scale", {0.9, 0.8, 1}), "gremlins"},
      {Cause("bending_stiffness", "all", "scale", {170, 160, 180}), "accepted: "},
      {Cause("bending_stiffness", "tendon:1", "scale", {0.9, 0.8, 1}), "where = 'tendon:1'"},
      {Cause("backlash", "tendon:4", "rad", {0.1, 0, 0.2}), "tendon:1 .. tendon:3"},
      {Cause("backlash", "all", "mm", {0.1, 0, 0.2}), "no parameter 'mm'"},
  };
  for (const auto& c : causes) {
    Report(Verdict::kAttributed, {c.cause});
    EXPECT_EQ(Apply("report.json --out new.yaml"), 1) << c.says;
    EXPECT_THAT(error_, HasSubstr(c.says));
    EXPECT_TRUE(OneLine());
  }
  WriteText(folder_ / "broken.json", ReadText(folder_ / "report.json").substr(0, 500));
  WriteText(folder_ / "other.json", "{\"a\": 1}");
  WriteText(folder_ / "new_robot.yaml", "name: x\n");
  const struct {
    const char* arguments;
    int code;
    const char* says;
  } cases[] = {
      {"broken.json --out new.yaml", 1, "is not JSON"},
      {"other.json --out new.yaml", 1, "'format' is missing"},
      {"gone.json --out new.yaml", 1, "cannot read"},
      {"--out new.yaml", 2, "nothing to apply"},
      {"--effect 'backlash rad=0.1'", 2, "give either --out FILE, or --in-place"},
      {"--effect 'backlash rad=0.1' --out new.yaml --in-place", 2, "give either --out FILE, or --in-place"},
      {"--effect 'backlash rad=0.1' --out rig.yaml", 2, "--out is the robot file itself"},
      {"--effect 'backlash rad=0.1' --out ./../rig.yaml/../x/new.yaml", 1, "cannot write"},
      {"--effect 'backlash rad=9' --out new.yaml", 2, "accepted: 0 .. 1"},
      {"--effect 'backlash rad=0.1' --effect 'backlash rad=0.2' --out new.yaml", 1, "twice"},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(Apply(c.arguments), c.code) << c.arguments << error_;
    EXPECT_THAT(error_, HasSubstr(c.says)) << c.arguments;
  }
  EXPECT_EQ(Run("gap apply --robot new_robot.yaml --effect 'backlash rad=0.1' --out new.yaml"), 1);
  EXPECT_THAT(error_, HasSubstr("new_robot.yaml"));
  EXPECT_EQ(Run("gap apply --robot gone.yaml --effect 'backlash rad=0.1' --out new.yaml"), 1);
  EXPECT_FALSE(fs::exists(folder_ / "new.yaml"));
  EXPECT_FALSE(fs::exists(folder_ / "new.yaml.new"));
  EXPECT_EQ(ReadText(folder_ / "rig.yaml"), rig_);
}

TEST_F(ApplyCommandTest, AReportOfAnotherRobotIsReported) {
  Diagnosis d = gap::ExampleDiagnosis(Verdict::kAttributed);
  d.robot_name = "somebody_elses";
  d.robot_yaml = config::ToYaml(config::LoadRobot(kRig));
  d.accepted = {Cause("bending_stiffness", "all", "scale", {0.92, 0.91, 0.93})};
  WriteText(folder_ / "report.json", gap::ReportJson(d));
  EXPECT_EQ(Apply("report.json --out new.yaml"), 0);
  EXPECT_THAT(error_, HasSubstr("the report is about robot 'somebody_elses'"));
}

TEST_F(ApplyCommandTest, InPlaceChangesTheFileItself) {
  ASSERT_EQ(Apply("--effect 'tip_payload mass_kg=0.002' --in-place"), 0) << error_;
  const std::string once = ReadText(folder_ / "rig.yaml");
  EXPECT_NE(once, rig_);
  ASSERT_EQ(Apply("--effect 'torque_constant where=tendon:1 scale=0.9' --in-place"), 0) << error_;
  const RobotParameters robot = sim::LoadRobot(folder_ / "rig.yaml");
  EXPECT_EQ(robot.actuation->tendons[0].motor.torque_scale, 0.9);
  EXPECT_EQ(robot.actuation->tendons[1].motor.torque_scale, 1);
}

// A law that the file lists is not listed twice; one elsewhere stays.
TEST_F(ApplyCommandTest, AStrainIsSwitchedOnAndAKeyThatItsStiffnessReplacesGoes) {
  ASSERT_EQ(Apply("--effect 'axial_stiffness shortening=0.02' --out stretches.yaml"), 0) << error_;
  const std::string stretches = ReadText(folder_ / "stretches.yaml");
  EXPECT_THAT(stretches, HasSubstr("strains: [bending, extension]"));
  EXPECT_THAT(stretches, HasSubstr("axial_stiffness_N: 400"));
  std::string twisting = ReadText(folder_ / "rig.yaml");
  twisting.replace(twisting.find("      youngs_modulus_Pa"), 0,
                   "      strains: [bending, torsion]\n      poissons_ratio: 0.3     # NiTi\n");
  WriteText(folder_ / "twisting.yaml", twisting);
  ASSERT_EQ(
      Run("gap apply --robot twisting.yaml --effect 'torsional_stiffness compliance=1' --out twists.yaml"), 0)
      << error_;
  const std::string twists = ReadText(folder_ / "twists.yaml");
  EXPECT_THAT(twists,
              AllOf(HasSubstr("torsional_stiffness_Nm2: "), Not(HasSubstr("\n      poissons_ratio:"))));
  EXPECT_EQ(Run("config check twists.yaml"), 0) << error_;
}

TEST_F(ApplyCommandTest, ALawThatTheFileHasIsRewritten) {
  ASSERT_EQ(Apply("--effect 'backlash where=tendon:2 rad=0.1' --effect 'backlash where=tendon:3 rad=0.05' "
                  "--effect 'tendon_creep where=tendon:1 fraction=0.1' --in-place"),
            0)
      << error_;
  ASSERT_EQ(Apply("--effect 'backlash where=tendon:2 rad=0.02' --in-place"), 0) << error_;
  const RobotParameters robot = sim::LoadRobot(folder_ / "rig.yaml");
  ASSERT_EQ(robot.effects.size(), 3U);
  EXPECT_EQ(robot.effects[0].where, "tendon:2");
  EXPECT_EQ(robot.effects[0].values.at(0).second, 0.02);
  EXPECT_EQ(robot.effects[1].values.at(0).second, 0.05);
  EXPECT_EQ(robot.effects[2].name, "tendon_creep");
}

// A finding is relative to the robot file that the report was made with.
TEST_F(ApplyCommandTest, AReportIsRefusedOnAnyOtherFileThanItsOwn) {
  const Diagnosis d =
      Report(Verdict::kAttributed, {Cause("bending_stiffness", "all", "scale", {0.92, 0.91, 0.93})});
  ASSERT_EQ(Apply("report.json --in-place"), 0) << error_;
  const std::string once = ReadText(folder_ / "rig.yaml");
  EXPECT_EQ(Apply("report.json --in-place"), 1);
  EXPECT_THAT(error_, testing::ContainsRegex(
                          "report.json was made with another robot file: "
                          "body.sections\\[0\\].youngs_modulus_Pa is [0-9.e]+ there and [0-9.e]+ in "
                          "rig.yaml"));
  EXPECT_THAT(error_, HasSubstr("--anyway"));
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(ReadText(folder_ / "rig.yaml"), once);
  ASSERT_EQ(Apply("report.json --in-place --anyway"), 0) << error_;
  EXPECT_THAT(error_, HasSubstr("warning: report.json was made with another robot file"));
  EXPECT_NE(ReadText(folder_ / "rig.yaml"), once);

  const auto refused = [&](const std::string& effect, const std::string& key) {
    WriteText(folder_ / "rig.yaml", rig_);
    ASSERT_EQ(Apply(fmt::format("--effect '{}' --in-place", effect)), 0) << error_;
    EXPECT_EQ(Apply("report.json --out new.yaml"), 1) << effect;
    EXPECT_THAT(error_, HasSubstr(key)) << effect;
  };
  refused("torque_constant where=tendon:2 scale=0.9", "torque_scale of tendon 2 is ");
  refused("backlash where=tendon:1 rad=0.05",
          "effects[0] is nothing there and backlash where=tendon:1 rad=0.05 in rig.yaml");
  EXPECT_FALSE(fs::exists(folder_ / "new.yaml"));
  // The same values in another layout describe the same robot.
  WriteText(folder_ / "rig.yaml", d.robot_yaml);
  EXPECT_EQ(Apply("report.json --out new.yaml"), 0) << error_;
  EXPECT_EQ(error_, "");
  // A report that does not contain its robot file.
  Diagnosis old = d;
  old.robot_yaml.clear();
  WriteText(folder_ / "report.json", gap::ReportJson(old));
  EXPECT_EQ(Apply("report.json --out newer.yaml"), 1);
  EXPECT_THAT(error_, HasSubstr("does not contain the robot file it was made with"));
  EXPECT_EQ(Apply("report.json --out new.yaml --anyway --overwrite"), 0) << error_;
}

TEST_F(ApplyCommandTest, AnExistingFileIsReplacedOnlyOnRequest) {
  WriteText(folder_ / "new.yaml", "somebody's work\n");
  EXPECT_EQ(Apply("--effect 'tip_payload mass_kg=0.002' --out new.yaml"), 2);
  EXPECT_THAT(error_, HasSubstr("new.yaml already exists"));
  EXPECT_EQ(ReadText(folder_ / "new.yaml"), "somebody's work\n");
  EXPECT_EQ(Apply("--effect 'tip_payload mass_kg=0.002' --out new.yaml --overwrite"), 0) << error_;
  EXPECT_NE(ReadText(folder_ / "new.yaml"), "somebody's work\n");
}

TEST_F(ApplyCommandTest, ThroughALinkTheFileBehindItIsChanged) {
  fs::rename(folder_ / "rig.yaml", folder_ / "real.yaml");
  fs::permissions(folder_ / "real.yaml", fs::perms(0640));
  fs::create_symlink("real.yaml", folder_ / "rig.yaml");
  WriteText(folder_ / "real.yaml.new", "mine");
  ASSERT_EQ(Apply("--effect 'tip_payload mass_kg=0.002' --in-place"), 0) << error_;
  EXPECT_TRUE(fs::is_symlink(folder_ / "rig.yaml"));
  EXPECT_THAT(ReadText(folder_ / "real.yaml"), HasSubstr("tip_payload mass_kg=0.002"));
  EXPECT_EQ(fs::status(folder_ / "real.yaml").permissions(), fs::perms(0640));
  EXPECT_EQ(ReadText(folder_ / "real.yaml.new"), "mine");
}

TEST_F(ApplyCommandTest, AByteOrderMarkIsAcceptedAndKept) {
  const std::string mark = "\xEF\xBB\xBF";
  for (const std::string& text : {rig_, rig_.substr(rig_.find("name:"))}) {
    WriteText(folder_ / "rig.yaml", mark + text);
    ASSERT_EQ(Run("config check rig.yaml"), 0) << error_;
    ASSERT_EQ(Apply("--effect 'bending_stiffness scale=0.9' --in-place"), 0) << error_;
    const std::string after = ReadText(folder_ / "rig.yaml");
    EXPECT_TRUE(after.starts_with(mark));
    EXPECT_EQ(after.find(mark, 1), after.npos);
    EXPECT_NEAR(sim::LoadRobot(folder_ / "rig.yaml").body.sections[0].youngs_modulus_Pa /
                    sim::LoadRobot(kRig).body.sections[0].youngs_modulus_Pa,
                0.9, 1e-12);
  }
}

TEST_F(ApplyCommandTest, ExplainNamesTheParametersOfSingleMotors) {
  ASSERT_EQ(Run("gap explain cogging"), 0);
  EXPECT_THAT(out_, testing::HasSubstr("phase_2_rad, ... where=all: the value of tendons 2, 3, ... less"));
  ASSERT_EQ(Run("gap explain cogging --json"), 0);
  EXPECT_EQ(json::parse(out_)["parameters"][2]["each"], "phase_{}_rad") << out_;
  EXPECT_EQ(Apply("--effect 'cogging amplitude_Nm=1e-4 phase_2_rad=0.5 phase_4_rad=1' --out new.yaml"), 2);
  EXPECT_THAT(error_, testing::HasSubstr("cogging has no parameter 'phase_4_rad'"));
  EXPECT_EQ(Apply("--effect 'cogging amplitude_Nm=1e-4 phase_2_rad=0.5' --out new.yaml"), 0) << error_;
}

// Every command that `explain` suggests works: every effect, at its plainly visible size.
TEST_F(ApplyCommandTest, WhatExplainSuggestsCanBeApplied) {
  ASSERT_EQ(Run("gap explain --json"), 0);
  const json effects = json::parse(out_);
  ASSERT_EQ(effects.size(), sim::Effects().size());
  for (const json& effect : effects) {
    const std::string name = effect["effect"];
    ASSERT_EQ(Run("gap explain " + name), 0) << name;
    const std::string flag = "--effect \"";
    const auto at = out_.find(flag);
    ASSERT_NE(at, std::string::npos) << name;
    const std::string setting =
        out_.substr(at + flag.size(), out_.find('"', at + flag.size()) - at - flag.size());
    EXPECT_EQ(Apply(fmt::format("--effect '{}' --out new.yaml --overwrite", setting)), 0)
        << setting << error_;
  }
}

TEST_F(ApplyCommandTest, ExplainListsEffectsThatMatchAWord) {
  ASSERT_EQ(Run("gap explain friction"), 0) << error_;
  for (const char* effect : {"routing_friction", "capstan_alpha", "motor_coulomb", "motor_viscous",
                             "stribeck", "presliding", "pulley_coulomb", "gear_efficiency", "wrap_angle"})
    EXPECT_THAT(out_, HasSubstr(fmt::format("\n  {} ", effect)));
  EXPECT_THAT(out_, testing::Not(HasSubstr("\n  tracker_delay ")));
  EXPECT_LT(out_.find("routing_friction "), out_.find("wrap_angle ")) << "what is named so comes first";
  ASSERT_EQ(Run("gap explain friction --json"), 0) << error_;
  const json list = json::parse(out_);
  ASSERT_TRUE(list.is_array());
  EXPECT_GE(list.size(), 8u);
  ASSERT_EQ(Run("gap explain 'Routing Friction'"), 0) << error_;
  EXPECT_THAT(out_, testing::StartsWith("routing_friction: ")) << "a whole name is that effect alone";
}

TEST_F(ApplyCommandTest, ExplainKnowsThePlacesOfARobot) {
  ASSERT_EQ(Run("gap explain unit_stiffness --json --robot rig.yaml"), 0) << error_;
  const json effect = json::parse(out_);
  EXPECT_EQ(effect["places"], (json{"unit:1", "unit:2", "unit:3", "unit:4"}));
  EXPECT_EQ(effect["first_cut"], "C4");
  ASSERT_EQ(Run("gap explain --json --robot rig.yaml"), 0) << error_;
  const RobotParameters robot = sim::LoadRobot(kRig);
  for (const json& e : json::parse(out_)) {
    ASSERT_FALSE(e["places"].empty());
    for (const json& place : e["places"]) {
      EXPECT_NO_THROW(
          sim::ParseTarget(*sim::FindEffect(e["effect"].get<std::string>()), place.get<std::string>(), robot))
          << e["effect"];
    }
  }
  ASSERT_EQ(Run("gap explain backlash --robot rig.yaml"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("On rig_90mm; in proportion to"));
  EXPECT_EQ(Run("gap explain --robot rig.yaml"), 2);
  EXPECT_EQ(Run("gap explain --json --robot gone.yaml"), 1);
  EXPECT_EQ(Run("gap explain gremlins"), 2);
  EXPECT_EQ(Run("gap explain BACKLASH"), 0) << "as people write it";
  EXPECT_EQ(Run("gap explain bakclash"), 2);
  EXPECT_THAT(error_, HasSubstr("did you mean backlash?"));
  EXPECT_EQ(Apply("--effect 'BACKLASH rad=0.1' --out new.yaml"), 2);
  EXPECT_THAT(error_, HasSubstr("did you mean backlash?"));
}

TEST_F(ApplyCommandTest, AReportIsDrawnAgainFromItsNumbers) {
  Report(Verdict::kAttributed, {Cause("bending_stiffness", "all", "scale", {0.92, 0.91, 0.93})});
  ASSERT_EQ(Run("gap report report.json --out page"), 0) << error_;
  EXPECT_EQ(ReadText(folder_ / "page/report.json"), ReadText(folder_ / "report.json"));
  EXPECT_GT(ReadText(folder_ / "page/report.html").size(), 100000u);
  EXPECT_EQ(Run("gap report gone.json --out page2"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(Run("gap report report.json --out rig.yaml"), 1);
  EXPECT_EQ(Run("gap report"), 2);
}

}  // namespace
}  // namespace tendril
