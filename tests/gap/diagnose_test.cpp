// The diagnosis from logs to verdict: runs of the simulated rig with an effect planted.
#include "tendril/gap/diagnose.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rig_runs.h"
#include "tendril/gap/report.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Verdict;

// A compliant wall responds differently from a stiff one: both stiffness scales are searched, in every
// direction.
TEST(Diagnose, SoftWallIsFoundWhereItStands) {
  const Diagnosis d = Diagnose(RecordedAt500Hz("contact stiffness_Npm=0.15 gap_m=0.014 angle_rad=-0.5", 4),
                               Only({"contact", "tip_force", "base_tilt", "bending_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "contact") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("stiffness_Npm").value, 0.15, 0.03);
  EXPECT_NEAR(d.accepted[0].parameters.at("gap_m").value, 0.014, 0.003);
  EXPECT_NEAR(d.accepted[0].parameters.at("angle_rad").value, -0.5, 0.1);
  EXPECT_THAT(d.sentence, testing::ContainsRegex("contact, stiffness 0\\.1[0-9]* N/m"));
}

// Angles are periodic: from the start at half a turn the search continues beyond it.
TEST(Diagnose, AWallBehindIsFoundAcrossHalfATurn) {
  const Diagnosis d = Diagnose(RecordedAt500Hz("contact stiffness_Npm=0.15 gap_m=0.014 angle_rad=-2.9"),
                               Only({"contact", "tip_force", "base_tilt", "bending_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "contact") << d.sentence;
  EXPECT_FALSE(d.accepted[0].bound_hit);
  const double off_rad = d.accepted[0].parameters.at("angle_rad").value + 2.9;
  EXPECT_NEAR(std::remainder(off_rad, 2 * std::numbers::pi), 0, 0.1);
}

// A zero so far off that the model's tendon is slack: no derivative there tells how far.
TEST(Diagnose, AZeroFarOffIsFoundThoughTheModelsTendonIsSlack) {
  const Diagnosis d = Diagnose(RecordedAt500Hz("encoder_offset where=tendon:2 rad=-0.43", 3),
                               Only({"encoder_offset", "slack", "tendon_stiffness", "cell_offset"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "encoder_offset") << d.sentence;
  EXPECT_EQ(d.accepted[0].where, "tendon:2");
  EXPECT_NEAR(d.accepted[0].parameters.at("rad").value, -0.43, 0.02);
  // A different zero at rest is not an unrecorded motion.
  EXPECT_THAT(d.degradations, testing::Not(testing::Contains(testing::HasSubstr("begins in motion"))));
}

// So far off that all tendons of the model are slack, and still are after a step of 0.4 rad towards it.
TEST(Diagnose, AZeroFarOffOfAllTendonsIsFound) {
  const Diagnosis d = Diagnose(RecordedAt500Hz("encoder_offset rad=-1.1", 2.5),
                               Only({"encoder_offset", "slack", "tendon_stiffness", "capstan_n"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "encoder_offset") << d.sentence;
  EXPECT_EQ(d.accepted[0].where, "all");
  EXPECT_NEAR(d.accepted[0].parameters.at("rad").value, -1.1, 0.02);
}

TEST(Diagnose, NominalRigHasNoGap) {
  const Diagnosis d = Diagnose(RecordedAt500Hz(""), {});
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  ASSERT_TRUE(Named(d, "no_gap"));  // what is too small for the data is a gap too
  EXPECT_GT(Named(d, "no_gap")->p, 0.5);
  EXPECT_LT(Named(d, "no_gap")->p, 0.7 + 1e-12);
  EXPECT_TRUE(d.accepted.empty());
}

struct Planted {
  const char* name;
  const char* effect;
  const char* parameter;
  double value;
  double tolerance;
  sim::Cut cut;
};

void PrintTo(const Planted& planted, std::ostream* out) { *out << planted.effect; }

class DiagnosePlanted : public testing::TestWithParam<Planted> {};

TEST_P(DiagnosePlanted, IsFoundWithItsPlaceItsValueAndCloses) {
  const Planted& planted = GetParam();
  const Diagnosis d = Diagnose(RecordedAt500Hz(planted.effect, 4),
                               Only({"torque_constant", "gear_efficiency", "motor_coulomb", "capstan_alpha",
                                     "pulley_coulomb", "tendon_stiffness", "slack", "bending_stiffness",
                                     "unit_mass", "tip_payload", "contact", "cell_offset", "cell_gain"}));
  const EffectSetting setting = sim::ParseEffect(planted.effect, Rig());
  EXPECT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  ASSERT_EQ(d.accepted.size(), 1u) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, setting.name);
  EXPECT_EQ(d.accepted[0].where, setting.where);
  EXPECT_NEAR(d.accepted[0].parameters.at(planted.parameter).value, planted.value, planted.tolerance);
  EXPECT_EQ(First(d), planted.cut);
  ASSERT_TRUE(d.closed.has_value());
  EXPECT_GT(d.closed->value, 0.9);
  // With the cause, the simulator that sees nothing but commands is off by the tracker's noise.
  const double noise_m = std::sqrt(3) * Rig().actuation->tracker->position_noise_m;
  ASSERT_FALSE(d.free_runs.empty());
  for (const gap::FreeRun& run : d.free_runs) {
    SCOPED_TRACE(run.run);
    std::printf("%s, %s: tip moves %.3f mm, off by %.3f mm, with the cause %.3f mm\n", planted.name,
                run.family.c_str(), 1e3 * run.moves_m, 1e3 * run.before_m, 1e3 * run.after_m.value());
    EXPECT_LT(run.after_m, 1.2 * noise_m);
    if (planted.cut == sim::Cut::kSensors) {
      EXPECT_EQ(run.after_m, run.before_m);
    } else {
      EXPECT_GT(run.before_m, 1.3 * noise_m);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Effects, DiagnosePlanted,
    testing::Values(
        Planted{"Stiffness", "bending_stiffness scale=0.93", "scale", 0.93, 0.005, sim::Cut::kShape},
        Planted{"TorqueConstant", "torque_constant scale=0.88", "scale", 0.88, 0.01, sim::Cut::kDrivetrain},
        Planted{"CellGain", "cell_gain where=tendon:2 scale=1.06", "scale", 1.06, 0.006, sim::Cut::kSensors},
        Planted{"TendonStiffness", "tendon_stiffness scale=0.8", "scale", 0.8, 0.03, sim::Cut::kTendon}),
    [](const testing::TestParamInfo<Planted>& test) { return std::string(test.param.name); });

// A cell that reads 6 % too much: the measured tension exceeds the one from torque by 6 % at every tension,
// and by nothing once the gain is in the model.
TEST(Diagnose, MapsAndCurvesShowTheSignatureOfTheCause) {
  constexpr double kGain = 1.06;
  const Diagnosis d = Diagnose(RecordedAt500Hz("cell_gain where=tendon:2 scale=1.06"), Only({"cell_gain"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;

  const auto map = std::find_if(d.maps.begin(), d.maps.end(), [](const gap::ConditionMap& m) {
    return m.channel == "tension 2 from torque" && m.condition == "tension";
  });
  ASSERT_NE(map, d.maps.end());
  ASSERT_GE(map->at.size(), 5u);
  ASSERT_EQ(map->after.size(), map->at.size());
  EXPECT_GT(map->at.back() - map->at.front(), 4);
  for (std::size_t i = 0; i < map->at.size(); ++i) {
    EXPECT_NEAR(map->mean[i], (1 - 1 / kGain) * map->at[i], 0.03) << map->at[i];
    EXPECT_NEAR(map->after[i], 0, 0.03) << map->at[i];
    EXPECT_LE(map->low[i], map->mean[i]);
    EXPECT_GE(map->high[i], map->mean[i]);
  }

  const auto curve = std::find_if(d.overlays.begin(), d.overlays.end(),
                                  [](const gap::Overlay& o) { return o.channel == "tension 2 from torque"; });
  ASSERT_NE(curve, d.overlays.end());
  ASSERT_EQ(curve->after.size(), curve->measured.size());
  ASSERT_EQ(curve->x.size(), curve->measured.size());
  double before = 0, after = 0, measured = 0;
  for (std::size_t i = 0; i < curve->measured.size(); ++i) {
    if (!std::isfinite(curve->measured[i])) continue;
    before += std::pow(curve->measured[i] - curve->before[i], 2);
    after += std::pow(curve->measured[i] - curve->after[i], 2);
    measured += std::pow(curve->measured[i], 2);
  }
  EXPECT_NEAR(std::sqrt(before / measured), 1 - 1 / kGain, 0.01);
  EXPECT_LT(std::sqrt(after / measured), 0.01);

  // Before, the residual correlates with the tension; with the cause in the model it does not.
  ASSERT_FALSE(d.input_correlations.empty());
  for (const auto& [pair, correlation] : d.input_correlations) {
    if (!pair.starts_with("tension 2 from torque")) continue;
    EXPECT_LT(std::abs(correlation), 0.3) << pair;
  }
}

// A small friction is found with two families of motion and attributed to chance with one: the same data with
// other family names.
TEST(Diagnose, ASingleFamilyNeedsMoreEvidenceOfAGap) {
  DataSet set = Recorded("motor_coulomb scale=1.02", 4.5);
  set.runs.erase(set.runs.begin() + 1, set.runs.begin() + 3);
  const auto only = Only({"bending_stiffness", "motor_viscous", "motor_coulomb", "tendon_stiffness"});
  const Diagnosis one = Diagnose(set, only);
  set.runs.back().family = "another";
  const Diagnosis two = Diagnose(set, only);
  EXPECT_EQ(one.verdict, Verdict::kNoGap) << one.sentence;
  EXPECT_NE(two.verdict, Verdict::kNoGap) << two.sentence;
}

// A deviation that is significant at no place, and of which no cause closes anything, is not called a gap.
TEST(Diagnose, NoSignificantPlaceAndNoClosureIsInsufficientData) {
  RobotParameters plant = Rig();
  plant.effects.push_back(sim::ParseEffect("command_delay s=0.0008", plant));
  DataSet set;
  set.robot = Rig();
  set.runs = {Record(plant, "triangle", 3, 7), Record(plant, "triangle", 3, 8)};
  set.runs[1].name = "again";
  set.runs[1].repeat_of = "triangle";
  const Diagnosis d = Diagnose(set, Only({"command_delay", "bending_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kInsufficientData) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("not enough to tell whether there is a gap"));
}

// A large deviation in one short run is not called no gap either.
TEST(Diagnose, ALargeExcessInTooFewSecondsIsInsufficientData) {
  DataSet set;
  set.robot = Rig();
  set.runs = {Record(Rig(), "circle", 2, 7)};
  for (auto tip_m : set.runs[0].tip_m.rowwise()) tip_m.head(2) *= 1 - 3 * tip_m.head(2).norm();
  const Diagnosis d = Diagnose(set, Only({"contact", "unit_mass"}));
  EXPECT_EQ(d.verdict, Verdict::kInsufficientData) << d.sentence;
  EXPECT_THAT(d.sentence,
              testing::ContainsRegex("C4 \\(tip position\\) is .* sigma off, in too few seconds"));
  // Without it there is none.
  set.runs = {Record(Rig(), "circle", 2, 7)};
  EXPECT_EQ(Diagnose(set, Only({"contact", "unit_mass"})).verdict, Verdict::kNoGap);
}

// The cogging phases of the motors differ.
TEST(Diagnose, DetentsOfAllMotorsAreFoundEachWithItsPhase) {
  const Diagnosis d =
      Diagnose(RecordedAt500Hz("cogging amplitude_Nm=1.5e-4 phase_rad=0.5 phase_2_rad=1.9 phase_3_rad=-2"),
               Only({"cogging", "stribeck", "motor_coulomb", "gear_efficiency", "torque_constant"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  ASSERT_EQ(d.accepted.size(), 1u) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "cogging") << d.sentence;
  EXPECT_EQ(d.accepted[0].where, "all") << d.sentence;
  const auto value = [&](const char* name) { return d.accepted[0].parameters.at(name).value; };
  EXPECT_NEAR(value("amplitude_Nm"), 1.5e-4, 0.1e-4);
  EXPECT_NEAR(std::remainder(value("phase_2_rad") - 1.9, 2 * std::numbers::pi), 0, 0.15);
  EXPECT_NEAR(std::remainder(value("phase_3_rad") + 2, 2 * std::numbers::pi), 0, 0.15);
}

// If the only family that reaches the limit is held out, the others do not determine the limit.
TEST(Diagnose, ALimitThatOneKindOfExperimentReachesIsFound) {
  RobotParameters plant = Rig();
  const std::string effect = "torque_saturation where=all deficit_Nm=0.0042";  // at about 6.8 N
  plant.effects.push_back(sim::ParseEffect(effect, plant));
  DataSet set;
  set.name = "test";
  set.robot = Rig();
  set.runs = {Record(plant, "multisine", 7, 1, 500), Record(plant, "multisine", 7, 2, 500),
              Record(plant, "circle", 7, 3, 500)};
  set.runs[1].name = set.runs[1].family = "other";
  const Diagnosis d = Diagnose(set, Only({"torque_saturation", "torque_constant", "torque_loop_lag",
                                          "command_delay", "motor_coulomb"}));
  EXPECT_EQ(d.causes[0].effect, "torque_saturation") << d.sentence;
  EXPECT_NEAR(d.causes[0].parameters.at("deficit_Nm").value, 0.0042, 2e-5);
  EXPECT_NE(d.causes[0].note.find("only one kind of experiment"), std::string::npos) << d.causes[0].note;
  EXPECT_EQ(First(d), sim::Cut::kCurrentLoop);
}

TEST(Diagnose, AnEffectOutsideTheLibraryIsUnexplained) {
  gap::DiagnoseOptions options;
  options.without = {"backlash"};
  options.menu.families.clear();
  const Diagnosis d = Diagnose(RecordedAt500Hz("backlash rad=0.3", 3), options);
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  ASSERT_NE(Named(d, "unknown"), nullptr);
  EXPECT_GT(Named(d, "unknown")->p, 0.5);
}

TEST(Diagnose, TheSameForAnyNumberOfThreads) {
  const DataSet set = RecordedAt500Hz("tip_payload mass_kg=0.002", 3);
  gap::DiagnoseOptions one = Only({"tip_payload", "unit_mass", "bending_stiffness", "cell_gain"});
  one.menu = {};  // the plan of the next experiment runs on the threads as well
  gap::DiagnoseOptions two = one;
  one.threads = 1;
  two.threads = 2;
  Diagnosis a = Diagnose(set, one), b = Diagnose(set, two);
  a.seconds = b.seconds = 0;
  EXPECT_EQ(gap::ReportJson(a), gap::ReportJson(b));
}

}  // namespace
}  // namespace tendril
