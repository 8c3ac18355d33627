// The diagnosis from logs to verdict: runs of the simulated rig with an effect planted, recorded as its
// sensors show them.
#include "tendril/gap/diagnose.h"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "tendril/config/config.h"
#include "tendril/gap/report.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/plant.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Run;
using gap::Verdict;

RobotParameters Rig() { return config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml"); }

/// Motor torque that approximately holds a tension.
constexpr double kTorquePerN = 0.008 / 19;

/// Commanded base tensions [N] of a family's run at time t [s].
Eigen::Vector3d CommandedTension(const std::string& family, double t) {
  constexpr double kRest_s = 0.5;
  const Eigen::Vector3d rest(0.3, 0.3, 0.3);
  if (t < kRest_s) return rest;
  const double s = t - kRest_s;
  const double begin = std::min(1.0, s);
  Eigen::Vector3d tension_N = rest;
  for (int j = 0; j < 3; ++j) {
    const double phase = 2 * std::numbers::pi * j / 3;
    if (family == "circle") tension_N[j] += begin * 3.5 * (1 + std::sin(1.6 * s - phase));
    if (family == "sway") tension_N[j] += begin * 2.2 * (1 + std::sin(20 * s - phase));
    if (family == "gentle") tension_N[j] += begin * 0.15 * (1 + std::sin(1.6 * s - phase));
    if (family == "triangle") {
      const double part = std::fmod(s / 3 + j / 3.0, 1.0);
      tension_N[j] += begin * 7 * (1 - std::abs(2 * part - 1));
    }
    if (family == "slow") {
      const double part = std::fmod(s / 6 + j / 3.0, 1.0);
      tension_N[j] += begin * 9 * (1 - std::abs(2 * part - 1));
    }
    if (family == "multisine") {
      tension_N[j] += begin * (3.2 + 1.8 * std::sin(3 * s + phase) + 0.9 * std::sin(13 * s + 2 * phase));
    }
  }
  return tension_N;
}

/// Friction torque at a motor's shaft in addition to the plant's, as a function of its state and the time.
using Rub = std::function<double(int j, const sim::TendonState& state, double time_s)>;

/// One run of a plant as the rig's sensors record it, at 1 kHz, the tracker at 100 Hz.
Run Record(sim::Plant& plant, const std::string& family, double duration_s, const Rub& rub = nullptr) {
  const RobotParameters nominal = Rig();
  const auto& p = nominal.actuation->tendons[0];
  const int samples = static_cast<int>(duration_s * 1000);
  Run run;
  run.name = family;
  run.family = family;
  run.time_s = Eigen::VectorXd::LinSpaced(samples, 0, 1e-3 * (samples - 1));
  for (auto* matrix :
       {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N}) {
    matrix->setZero(samples, 3);
  }
  run.tip_m.setConstant(samples, 3, std::nan(""));
  run.tip_quaternion.setConstant(samples, 4, std::nan(""));
  Eigen::Vector3d sent = CommandedTension(family, 0) * kTorquePerN, rubbed = Eigen::Vector3d::Zero();
  for (int i = 0; i < samples; ++i) {
    const auto sensors = plant.ReadSensors();
    const Eigen::Vector3d target = CommandedTension(family, 1e-3 * i) * kTorquePerN;
    for (int j = 0; j < 3; ++j) {
      run.torque_target_Nm(i, j) = target[j];
      run.torque_actual_Nm(i, j) = sensors[j].torque_Nm + rubbed[j];
      run.motor_position_rad(i, j) =
          2 * std::numbers::pi / p.drive.encoder_counts_per_turn * sensors[j].encoder_counts;
      run.tension_N(i, j) = sensors[j].load_cell_V / p.load_cell.gain_VpN;
    }
    if (i % 10 == 0) {
      const auto seen = plant.ReadTracker();
      run.tip_m.row(i) = seen.tip_W_m;
      const auto& o = seen.orientation_WT;
      run.tip_quaternion.row(i) << o.w(), o.x(), o.y(), o.z();
    }
    // A target acts at the SYNC after the cycle in which it was sent.
    for (int j = 0; rub && j < 3; ++j) rubbed[j] = rub(j, plant.tendon()[j], 1e-3 * i);
    plant.SetTorque(sent - rubbed);
    sent = target;
    plant.Advance(kNsPerMs);
  }
  return run;
}

Run Record(const RobotParameters& plant_robot, const std::string& family, double duration_s,
           std::uint64_t seed) {
  sim::Plant plant(plant_robot, {.seed = seed});
  return Record(plant, family, duration_s);
}

/// Three families and a repetition, 20 s in all.
DataSet Recorded(const std::vector<std::string>& effects, double duration_s = 5, std::uint64_t seed = 11) {
  DataSet set;
  set.name = "test";
  set.robot = Rig();
  RobotParameters plant = Rig();
  for (const auto& effect : effects) plant.effects.push_back(sim::ParseEffect(effect, plant));
  for (const char* family : {"circle", "triangle", "multisine"}) {
    set.runs.push_back(Record(plant, family, duration_s, seed++));
  }
  set.runs.push_back(Record(plant, "circle", duration_s, seed++));
  set.runs.back().name = "circle again";
  set.runs.back().repeat_of = "circle";
  return set;
}

DataSet Recorded(const std::string& effect, double duration_s = 5) {
  return Recorded(effect.empty() ? std::vector<std::string>{} : std::vector{effect}, duration_s);
}

/// With the load cells between pulleys and robot; the last run repeats the first.
DataSet RecordedAtRobotSide(const std::string& effect, const std::vector<std::string>& families,
                            double duration_s, std::uint64_t seed) {
  DataSet set;
  set.robot = Rig();
  for (auto& tendon : set.robot.actuation->tendons) tendon.load_cell.place = LoadCellPlace::kRobotSide;
  RobotParameters plant = set.robot;
  if (!effect.empty()) plant.effects.push_back(sim::ParseEffect(effect, plant));
  for (const auto& family : families) set.runs.push_back(Record(plant, family, duration_s, seed++));
  for (auto& run : set.runs) run.load_cell = LoadCellPlace::kRobotSide;
  set.runs.back().name = families.front() + " again";
  set.runs.back().repeat_of = families.front();
  return set;
}

const gap::Cause* Named(const Diagnosis& d, const std::string& effect) {
  for (const auto& cause : d.causes) {
    if (cause.effect == effect) return &cause;
  }
  return nullptr;
}

sim::Cut First(const Diagnosis& d) {
  for (const auto& finding : d.location) {
    if (finding.first) return finding.cut;
  }
  return sim::Cut::kClock;
}

/// All effects but these: less to search.
gap::DiagnoseOptions Only(const std::vector<std::string>& effects) {
  gap::DiagnoseOptions options;
  for (const std::string& name : effects) EXPECT_NE(sim::FindEffect(name), nullptr) << name;
  for (const sim::Effect& effect : sim::Effects()) {
    if (std::find(effects.begin(), effects.end(), effect.name) == effects.end())
      options.without.emplace_back(effect.name);
  }
  return options;
}

// A compliant wall responds differently from a stiff one: both stiffness scales are searched, in every
// direction.
TEST(Diagnose, SoftWallIsFoundWhereItStands) {
  const Diagnosis d = Diagnose(Recorded("contact stiffness_Npm=0.15 gap_m=0.014 angle_rad=-0.5"),
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
  const Diagnosis d = Diagnose(Recorded("contact stiffness_Npm=0.15 gap_m=0.014 angle_rad=-2.9"),
                               Only({"contact", "tip_force", "base_tilt", "bending_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "contact") << d.sentence;
  EXPECT_FALSE(d.accepted[0].bound_hit);
  const double off_rad = d.accepted[0].parameters.at("angle_rad").value + 2.9;
  EXPECT_NEAR(std::remainder(off_rad, 2 * std::numbers::pi), 0, 0.1);
}

// A zero so far off that the model's tendon is slack: no derivative there tells how far.
TEST(Diagnose, AZeroFarOffIsFoundThoughTheModelsTendonIsSlack) {
  const Diagnosis d = Diagnose(Recorded("encoder_offset where=tendon:2 rad=-0.43"),
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
  const Diagnosis d = Diagnose(Recorded("encoder_offset rad=-1.1"),
                               Only({"encoder_offset", "slack", "tendon_stiffness", "capstan_n"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "encoder_offset") << d.sentence;
  EXPECT_EQ(d.accepted[0].where, "all");
  EXPECT_NEAR(d.accepted[0].parameters.at("rad").value, -1.1, 0.02);
}

TEST(Diagnose, NominalRigHasNoGap) {
  const Diagnosis d = Diagnose(Recorded(""), {});
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  ASSERT_TRUE(Named(d, "no_gap"));  // what is too small for the data is a gap too
  EXPECT_GT(Named(d, "no_gap")->p, 0.5);
  EXPECT_LT(Named(d, "no_gap")->p, 0.7 + 1e-12);
  EXPECT_TRUE(d.accepted.empty());
}

// A robot whose file was always wrong, and a mass added to its tip since: compared with the model alone both
// show, compared with the earlier runs only what changed.
TEST(Diagnose, ModelErrorsOfTheRunsFromBeforeAreSubtracted) {
  const std::vector<std::string> wrong{"bending_stiffness scale=0.85", "motor_coulomb scale=1.4"};
  std::vector<std::string> since = wrong;
  since.push_back("tip_payload mass_kg=0.003");
  const DataSet earlier = Recorded(wrong, 4, 31);
  const gap::DiagnoseOptions few =
      Only({"tip_payload", "unit_mass", "bending_stiffness", "motor_coulomb", "base_tilt", "cell_offset"});

  DataSet same = Recorded(wrong, 4, 41);
  CompareWithBefore(same, earlier);
  ASSERT_EQ(same.runs.size(), 8U);
  const Diagnosis unchanged = Diagnose(same, few);
  EXPECT_EQ(unchanged.verdict, Verdict::kNoGap) << unchanged.sentence;
  ASSERT_EQ(unchanged.runs.size(), 4U);
  EXPECT_EQ(unchanged.runs[0].before, "circle@before");

  DataSet changed = Recorded(since, 4, 51);
  CompareWithBefore(changed, earlier);
  const Diagnosis d = Diagnose(changed, few);
  ASSERT_FALSE(d.causes.empty());
  EXPECT_EQ(d.causes[0].effect, "tip_payload") << d.sentence;
  // A robot softer than its file bends further under a mass: the estimate may be off by as much, and its
  // interval includes that.
  const gap::Estimate mass = d.causes[0].parameters.at("mass_kg");
  EXPECT_LT(mass.low, 0.003);
  EXPECT_GT(mass.high, 0.003);
  EXPECT_GT(mass.low, 0.001);
  for (const auto& cause : d.accepted) {
    EXPECT_NE(cause.effect, "bending_stiffness") << d.sentence;
    EXPECT_NE(cause.effect, "motor_coulomb") << d.sentence;
  }
}

// A model that misses most of a motion cannot explain what changed in it.
TEST(Diagnose, NoCauseIsNamedWhenTheModelWasFarOffBefore) {
  const DataSet earlier = Recorded({"bending_stiffness scale=2"}, 4, 31);
  DataSet changed = Recorded({"bending_stiffness scale=2", "tip_payload mass_kg=0.01"}, 4, 51);
  CompareWithBefore(changed, earlier);
  const Diagnosis d = Diagnose(changed, Only({"tip_payload", "cell_gain"}));
  EXPECT_EQ(d.verdict, Verdict::kInsufficientData) << d.sentence;
  EXPECT_TRUE(d.accepted.empty()) << d.sentence;
  EXPECT_THAT(d.degradations,
              testing::Contains(testing::HasSubstr("of the motion before the change already")));
}

// A run recorded at another rate than before cannot be compared, and the earlier runs alone are not diagnosed
// instead.
TEST(Diagnose, WithoutARunToCompareTheRunsFromBeforeAreNotDiagnosedInstead) {
  DataSet earlier = Recorded("", 4), now = Recorded(std::vector<std::string>{}, 4, 41);
  for (gap::Run& run : now.runs) {
    const auto every_third = [](const Eigen::MatrixXd& all) {
      return Eigen::MatrixXd(all(Eigen::seq(0, Eigen::last, 3), Eigen::all));
    };
    run.time_s = every_third(run.time_s);
    for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                         &run.tension_N, &run.tip_m, &run.tip_quaternion})
      *values = every_third(*values);
  }
  CompareWithBefore(now, earlier);
  try {
    const Diagnosis d = Diagnose(now, Only({"tendon_stiffness"}));
    FAIL() << d.sentence;
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("no run is left that can be compared with one from before"));
    EXPECT_THAT(error.what(), testing::HasSubstr("a sample every 0.003 s, and every 0.001 s before"));
  }
}

// Nor can a different motion of the same name.
TEST(Diagnose, ARunFromBeforeOfOtherCommandsIsNotComparedWith) {
  DataSet earlier = Recorded("", 4), now = Recorded(std::vector<std::string>{}, 4, 41);
  earlier.runs[0] = Record(Rig(), "sway", 4, 5);
  earlier.runs[0].name = "circle";
  CompareWithBefore(now, earlier);
  const Diagnosis d = Diagnose(now, Only({"tendon_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations,
              testing::Contains(testing::HasSubstr(
                  "left out: circle: not the same commands as before: torque targets differ by ")));
}

// Without recorded targets the other signals identify the commands: the same shape of motion at another place
// is another motion; another zero of the encoders alone is not, as the other signals show.
TEST(Diagnose, WithoutTargetsTheOtherSignalsIdentifyTheCommands) {
  DataSet earlier = Recorded("", 4);
  const DataSet now = Recorded(std::vector<std::string>{}, 4, 41);
  const auto compared = [&](double motors_rad, double cells_N, double tip_m) {
    DataSet set = now, before = earlier;
    before.runs[0].motor_position_rad.array() += motors_rad;
    before.runs[0].tension_N.array() += cells_N;
    before.runs[0].tip_m.array() += tip_m;
    for (DataSet* one : {&set, &before}) {
      for (gap::Run& run : one->runs) {
        run.torque_target_Nm.resize(0, 0);
        run.torque_actual_Nm.resize(0, 0);
      }
    }
    CompareWithBefore(set, before);
    return Diagnose(set, Only({"tendon_stiffness", "tip_payload"})).degradations;
  };
  EXPECT_THAT(compared(40, 12, 0.1),
              testing::Contains(testing::ContainsRegex("left out: circle: not the same commands as before: "
                                                       ".*motor positions by 40 rad rms.*tensions by")));
  const std::vector<std::string> same = compared(0, 0, 0);
  EXPECT_THAT(same, testing::Not(testing::Contains(testing::HasSubstr("left out: "))));
  EXPECT_THAT(same, testing::Contains(testing::ContainsRegex("same commands from before \\(.* differ by")));
  EXPECT_THAT(compared(40, 0, 0),
              testing::Not(testing::Contains(testing::HasSubstr("same commands as bef"))));
}

// Target columns that only one of the runs has do not count as targets of zero.
TEST(Diagnose, TargetsThatTheRunFromBeforeLacksAreNotCompared) {
  DataSet earlier = Recorded("", 4), now = Recorded(std::vector<std::string>{}, 4, 41);
  earlier.runs[0].torque_target_Nm.resize(0, 0);
  CompareWithBefore(now, earlier);
  const Diagnosis d = Diagnose(now, Only({"tendon_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations, testing::Not(testing::Contains(testing::HasSubstr("left out: "))));
}

// Where an encoder is dead in both runs, their difference hides it.
TEST(Diagnose, ADeadEncoderBeforeAndAfterIsMasked) {
  DataSet earlier = Recorded("", 4), now = Recorded(std::vector<std::string>{}, 4, 41);
  for (DataSet* set : {&earlier, &now}) {
    for (gap::Run& run : set->runs) run.motor_position_rad.col(1).setZero();
  }
  CompareWithBefore(now, earlier);
  const Diagnosis d = Diagnose(now, Only({"tendon_stiffness", "unit_mass"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("motor position 2 stays at 0 rad")));
  EXPECT_THAT(d.degradations, testing::Not(testing::Contains(testing::HasSubstr("no cause is named"))));
}

// With only torque and motor positions recorded, a small residual does not show that the model is right.
TEST(Diagnose, RunsFromBeforeWithoutCellsAndTrackerAreNotBelievedToBeRight) {
  const std::vector<std::string> wrong{"torque_constant scale=0.85"};
  DataSet earlier = Recorded(wrong, 4, 31), same = Recorded(wrong, 4, 41);
  for (DataSet* set : {&earlier, &same}) {
    for (gap::Run& run : set->runs) {
      for (auto* values : {&run.tension_N, &run.tip_m, &run.tip_quaternion}) values->resize(0, 0);
    }
  }
  CompareWithBefore(same, earlier);
  const Diagnosis d = Diagnose(same, Only({"torque_constant", "motor_coulomb"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("the earlier model error (up to ")));
  EXPECT_THAT(d.degradations, testing::Not(testing::Contains(testing::HasSubstr("(up to 0 %"))));
}

// A body with little damping amplifies the noise of the cells that drive its replay, in shape and stretch:
// with the cause in the model the floor is higher than with the nominal robot, and nothing is left.
TEST(Diagnose, CellNoiseAmplifiedByAnUnderdampedBodyIsNoGap) {
  const DataSet set =
      RecordedAtRobotSide("bending_damping scale=0.2", {"circle", "triangle", "multisine", "circle"}, 7, 5);
  const Diagnosis d = Diagnose(
      set, Only({"bending_damping", "bending_stiffness", "unit_mass", "tendon_stiffness", "presliding"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  ASSERT_EQ(d.accepted.size(), 1u) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "bending_damping") << d.sentence;
  EXPECT_EQ(d.leftover_sigma, 0) << d.sentence;
  // Noise in the driving signal of a replay biases its damping upwards, by more than the interval: 0.24 here.
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.2, 0.05);
  EXPECT_THAT(d.degradations,
              testing::Contains(testing::HasSubstr("bending_damping amplifies the sensor noise")));
}

// Cell noise excites the body in a replay; a body damped more than the real one is excited less and fits
// better, which explains nothing. Gentle runs hardly contradict it.
TEST(Diagnose, ACalmerBodyIsNoSecondCause) {
  const DataSet set = RecordedAtRobotSide("slack where=tendon:3 m=3.3e-5", {"gentle", "gentle"}, 24, 21);
  const Diagnosis d = Diagnose(set, Only({"slack", "bending_damping"}));
  ASSERT_EQ(d.accepted.size(), 1u) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "slack") << d.sentence;
}

// A different spool radius scales the tendon travel per motor angle and nothing else. A smaller pitch circle
// of the tendon holes does so too, with a softer backbone to cancel its influence on the bend. Two errors
// that cancel are less likely than one that is not listed.
TEST(Diagnose, TwoCausesThatCancelAreNotAccepted) {
  DataSet set = Recorded("");
  for (auto& run : set.runs) run.motor_position_rad *= 1.008;
  const Diagnosis d =
      Diagnose(set, Only({"hole_radius", "bending_stiffness", "unit_mass", "tendon_stiffness", "slack"}));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_EQ(First(d), sim::Cut::kTendon) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("cancelled each other at C4, where there is no gap"));
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
  const Diagnosis d = Diagnose(Recorded(planted.effect),
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
  const Diagnosis d = Diagnose(Recorded("cell_gain where=tendon:2 scale=1.06"), Only({"cell_gain"}));
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

// A deviation of a few seconds in one run is lost in the scatter of a mean over all runs.
TEST(Diagnose, ABumpedTrackerInOneRunIsAGapThatNothingExplains) {
  DataSet set = Recorded("");
  gap::Run& run = set.runs[1];
  for (Eigen::Index i = 3000; i < run.tip_m.rows(); ++i) run.tip_m(i, 0) += 0.01;
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "tip_payload", "cell_gain", "backlash"}));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_EQ(First(d), sim::Cut::kShape);
  EXPECT_GT(d.leftover_sigma, 10);
}

/// The tracker's readings of a run stamped `late_ms` later.
void StampLater(Run& run, int late_ms) {
  for (Eigen::MatrixXd* m : {&run.tip_m, &run.tip_quaternion}) {
    const Eigen::MatrixXd read = *m;
    m->setConstant(std::nan(""));
    for (Eigen::Index i = 0; i < read.rows(); ++i) {
      if (i + late_ms >= 0 && i + late_ms < read.rows()) m->row(i + late_ms) = read.row(i);
    }
  }
}

// A tracker's computer restarted for each run has a different clock offset each time: in some runs the tip
// moves before the motors.
TEST(Diagnose, ATrackerOnAClockOfItsOwnHidesNoCauseAndIsNone) {
  const auto offset = [](DataSet set) {
    const int late_ms[] = {35, -52, 8, -17};
    for (std::size_t i = 0; i < set.runs.size(); ++i) StampLater(set.runs[i], late_ms[i]);
    return set;
  };
  const auto look_for = Only({"bending_damping", "unit_mass", "tracker_offset", "backlash"});
  const Diagnosis none = Diagnose(offset(Recorded("")), look_for);
  EXPECT_EQ(none.verdict, Verdict::kNoGap) << none.sentence;
  EXPECT_THAT(none.degradations,
              testing::Contains(testing::HasSubstr("the tracker's clock is not the drives'")));
  const Diagnosis damped = Diagnose(offset(Recorded("bending_damping scale=4")), look_for);
  ASSERT_EQ(damped.verdict, Verdict::kAttributed) << damped.sentence;
  EXPECT_EQ(damped.accepted[0].effect, "bending_damping");
  EXPECT_NEAR(damped.accepted[0].parameters.at("scale").value, 4, 0.2);
}

// A delay that all runs share is a finding, not a clock offset.
TEST(Diagnose, ATrackersOwnDelayIsFound) {
  DataSet set = Recorded("");
  for (gap::Run& run : set.runs) StampLater(run, 30);
  const Diagnosis d = Diagnose(set, Only({"bending_damping", "tracker_delay"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "tracker_delay");
  EXPECT_NEAR(d.accepted[0].parameters.at("s").value, 0.030, 0.001);
  EXPECT_THAT(d.degradations, testing::Not(testing::Contains(testing::HasSubstr("clock"))));
  EXPECT_THAT(d.sentence, testing::HasSubstr("The gap lies at C6 (tracker)"));
}

// Of several parameters the sentence gives the one that differs.
TEST(Diagnose, ARotatedTrackerIsFoundWithItsAngle) {
  const Diagnosis d = Diagnose(Recorded("tracker_rotation z_rad=0.2", 4), Only({"tracker_rotation"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("tracker_rotation, z 11.4"));
}

TEST(Diagnose, AFrozenCellAndImpossibleValuesDoNotHideTheCause) {
  DataSet set = Recorded("bending_stiffness scale=0.93", 7);
  set.runs[0].tension_N.col(0).tail(5000).setConstant(3);
  set.runs[1].tension_N(2500, 1) = 9999;
  set.runs[1].torque_actual_Nm(3000, 1) = 7;
  set.runs[2].tip_m(3000, 1) = 5;
  for (int i = 100; i < 7000; i += 50) set.runs[2].tension_N(i, 2) = i % 100 ? 0 : -1;
  set.runs[0].motor_position_rad(1500, 2) = 1e9;
  set.runs[1].motor_position_rad(1000, 0) = 300;
  set.runs[1].motor_position_rad(1800, 0) = -300;
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "tip_payload", "cell_gain", "cell_offset"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "bending_stiffness");
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.93, 0.003);
  const auto said = [&](const std::string& words) {
    return std::any_of(d.degradations.begin(), d.degradations.end(),
                       [&](const std::string& line) { return line.find(words) != std::string::npos; });
  };
  EXPECT_TRUE(said("circle: tension 1 stays at 3 N from 2 s"));
  EXPECT_TRUE(said("the load cell of tendon 1 has no data for 5"));
  EXPECT_TRUE(said("triangle: tension 2 has 1 value up to 9999 N"));
  EXPECT_TRUE(said("triangle: actual torque 2 has 1 value up to 7 N m"));
  EXPECT_TRUE(said("multisine: tip y has 1 value up to 5 m"));
  EXPECT_TRUE(said("multisine: tension 3 jumps to -1 N and back and "));
  EXPECT_TRUE(said("circle: motor position 3 jumps to 1e+09 rad and back, first at 1.5 s: taken as missing"));
  EXPECT_TRUE(said("triangle: motor position 1 jumps to 300 rad and back and 1 times more, first at 1 s: "));
  EXPECT_FALSE(said("degrees") || said("encoder counts"));
  EXPECT_THAT(d.sentence, testing::Not(testing::HasSubstr("Check the measurement")));
}

// The scatter between runs is known from the repeated runs; for a motor at rest in those it is taken from the
// other motors.
TEST(Diagnose, AMotorAtRestInTheRepeatedRunsGetsTheFloorOfTheOthers) {
  DataSet set = Recorded("");
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    gap::Run& run = set.runs[i];
    for (Eigen::Index j = 0; j < 3; ++j) {
      const double phase = 5.0 * static_cast<double>(i) + 2.0 * static_cast<double>(j);
      const Eigen::ArrayXd angle = 2 * std::numbers::pi * 1.3 * run.time_s.array() + phase;
      run.tension_N.col(j) += 0.04 * angle.sin().matrix();
    }
    if (i == 0 || i == 3) run.motor_position_rad.col(2).setConstant(run.motor_position_rad(0, 2));
  }
  const Diagnosis d = Diagnose(set, Only({"gear_efficiency", "cell_gain"}));
  int places = 0;
  for (const auto& finding : d.location) {
    if (finding.cut != sim::Cut::kDrivetrain) continue;
    EXPECT_TRUE(finding.measured) << finding.where;
    EXPECT_FALSE(finding.excess) << finding.where << ", " << finding.excess_sigma << " sigma";
    ++places;
  }
  EXPECT_EQ(places, 3);
}

// A push on the tip that differs from run to run biases all windows of a run together: they are not
// independent samples of the mean push, which is smaller than the difference between two repetitions.
TEST(Diagnose, RunToRunDifferencesAreNoGap) {
  DataSet set = Recorded("");
  const double push_N[] = {0.02, 0.01, 0.03, -0.005};
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    RobotParameters pushed = Rig();
    pushed.effects.push_back(sim::ParseEffect(fmt::format("tip_force x_N={}", push_N[i]), pushed));
    gap::Run run = Record(pushed, set.runs[i].family, 7, 40 + i);
    run.name = set.runs[i].name;
    run.repeat_of = set.runs[i].repeat_of;
    set.runs[i] = std::move(run);
  }
  const Diagnosis d = Diagnose(set, Only({"tip_force", "bending_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("repetitions differ by"));
}

// With a delay in the model nothing is left at any single place; the additional damping is spread over all of
// them, below the noise at each, and is found nevertheless.
TEST(Diagnose, ASecondCauseThatNoPlaceShowsIsFound) {
  const gap::DiagnoseOptions only = Only({"command_delay", "bending_damping", "unit_mass", "tip_payload"});
  const std::vector<std::string> both = {"command_delay s=0.0015", "bending_damping scale=1.08"};
  const Diagnosis d = Diagnose(Recorded(both), only);
  for (const auto& finding : d.location)
    EXPECT_TRUE(!finding.excess || finding.cut == sim::Cut::kCurrentLoop) << finding.excess_sigma;
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  ASSERT_EQ(d.accepted.size(), 2u) << d.sentence;
  ASSERT_TRUE(Named(d, "bending_damping") && Named(d, "command_delay"));
  EXPECT_NEAR(Named(d, "bending_damping")->parameters.at("scale").value, 1.08, 0.03);
  EXPECT_NEAR(Named(d, "command_delay")->parameters.at("s").value, 0.0015, 1e-4);
  // Where the second is excluded from the library, a residual that no place shows does not count against the
  // first;
  const auto without = Only({"command_delay", "unit_mass", "tip_payload"});
  const Diagnosis half = Diagnose(Recorded(both), without);
  EXPECT_EQ(half.leftover_sigma, 0) << half.sentence;
  ASSERT_TRUE(half.closed.has_value());
  EXPECT_GT(half.closed->value, 0.95);
  EXPECT_EQ(half.verdict, Verdict::kAttributed) << half.sentence;
  EXPECT_EQ(half.accepted.size(), 1u) << half.sentence;
  // a residual that a place shows does.
  const Diagnosis plain = Diagnose(Recorded({both[0], "bending_damping scale=2"}), without);
  ASSERT_TRUE(plain.closed.has_value());
  EXPECT_LT(plain.closed->value, 0.4);
  EXPECT_EQ(plain.verdict, Verdict::kUnexplained) << plain.sentence;
  // A single cause remains a single cause.
  const Diagnosis one = Diagnose(Recorded("command_delay s=0.0015"), only);
  EXPECT_EQ(one.accepted.size(), 1u) << one.sentence;
}

// A motor that reverses within a few samples, or waits and then steps, is not an encoder error.
TEST(Diagnose, QuickMotionsOfAMotorAreNotOutliers) {
  DataSet set = Recorded("", 4);
  const auto steps = [](Eigen::Index i) { return static_cast<double>(i / 700 % 2); };
  for (Eigen::Index i = 0; i < set.runs[0].time_s.size(); ++i) {
    set.runs[0].motor_position_rad(i, 0) = 5 * std::sin(2 * std::numbers::pi * static_cast<double>(i) / 6.3);
    set.runs[1].motor_position_rad(i, 0) = steps(i);
    set.runs[2].motor_position_rad(i, 0) = 5 * steps(i);  // most of a turn
  }
  for (const std::string& line : Diagnose(set, Only({"bending_stiffness"})).degradations) {
    EXPECT_THAT(line, testing::Not(testing::HasSubstr("jumps")));
    EXPECT_THAT(line, testing::Not(testing::HasSubstr("by a turn")));
  }
}

/// A run in which motor 1 is 1.5 rad off its path in one row, more than a twentieth of its travel; `pulls`:
/// with the tension change of its tendon's spring. Every n-th of its rows is kept.
DataSet WithOvershoot(int every, bool pulls) {
  DataSet set;
  set.robot = Rig();
  set.runs.push_back(Record(Rig(), "circle", 3, 7));
  Run& run = set.runs[0];
  std::vector<Eigen::Index> rows;
  for (Eigen::Index i = 0; i < run.time_s.size(); i += every) rows.push_back(i);
  run.time_s = run.time_s(rows).eval();
  for (Eigen::MatrixXd* m : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                             &run.tension_N, &run.tip_m, &run.tip_quaternion}) {
    *m = (*m)(rows, Eigen::all).eval();
  }
  const auto& tendon = set.robot.actuation->tendons[0];
  const Eigen::Index row = run.time_s.size() / 2;
  constexpr double kOff_rad = 1.5;
  run.motor_position_rad(row, 0) += kOff_rad;
  const double spring_N = tendon.tendon.stiffness_Npm * tendon.SpoolTravelPerMotorRad() * kOff_rad;
  if (pulls) run.tension_N(row, 0) += 0.8 * spring_N;
  return set;
}

std::string SaidOf(const DataSet& set) {
  std::string text;
  for (const std::string& line : Diagnose(set, Only({"bending_stiffness"})).degradations) text += line + "\n";
  return text;
}

// A leap that the file's motor can make is a motion; one that it cannot make is a motion if the tension
// follows, and then the file is wrong; otherwise it is an encoder error.
TEST(Diagnose, AnOvershootIsKeptWhereAMotorCanHaveMadeIt) {
  const std::string slow =
      SaidOf(WithOvershoot(12, false));  // 1.5 rad in 12 ms: 5.6 of 7 mN m beside the tendon
  EXPECT_THAT(slow, testing::Not(testing::HasSubstr("too weak")));
  EXPECT_THAT(slow, testing::Not(testing::ContainsRegex("jumps[^\n]*first at 1\\.")));  // half way
  const std::string quick = SaidOf(WithOvershoot(1, true));
  EXPECT_THAT(quick, testing::HasSubstr("kept; the file's motor is too weak for this log"));
  EXPECT_THAT(quick, testing::HasSubstr("actuation.motor.rotor_inertia_kgm2"));
  EXPECT_THAT(quick, testing::Not(testing::HasSubstr("jumps")));
  const std::string alone = SaidOf(WithOvershoot(1, false));
  EXPECT_THAT(alone, testing::ContainsRegex("motor position 1 jumps to [^\n]*: taken as missing there"));
  EXPECT_THAT(alone, testing::Not(testing::HasSubstr("too weak")));
}

TEST(Diagnose, ColumnsOfAnotherUnitAreLeftOutAndTheRestIsDiagnosed) {
  DataSet set = Recorded("bending_stiffness scale=0.93");
  for (gap::Run& run : set.runs) run.tension_N.col(1) *= 1000 / 9.81;
  const Diagnosis d =
      Diagnose(set, Only({"bending_stiffness", "tip_payload", "cell_gain", "torque_constant"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "bending_stiffness") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.93, 0.003);
  EXPECT_NE(d.degradations.front().find("tension 2 reaches"), std::string::npos) << d.degradations.front();
}

// A missing sensor neither causes a gap nor hides one that the other sensors show.
struct Lost {
  const char* name;
  std::function<void(Run&)> what;
};

/// Removes `lost` rows of a run, from row `from` on.
void Lose(Run& run, Eigen::Index lost, Eigen::Index from) {
  const Eigen::Index rows = run.time_s.size(), kept = rows - lost;
  const auto without = [&](auto& values) {
    if (values.rows() != rows) return;
    values.middleRows(from, kept - from) = values.bottomRows(kept - from).eval();
    values.conservativeResize(kept, values.cols());
  };
  for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N,
                       &run.tip_m, &run.tip_quaternion})
    without(*values);
  run.time_s.segment(from, kept - from) = run.time_s.tail(kept - from).eval();
  run.time_s.conservativeResize(kept);
}

/// Removes 0.7 s of rows at a third of every run.
void LoseRows(Run& run) { Lose(run, 700, run.time_s.size() / 3); }

class DiagnoseWithLess : public testing::TestWithParam<Lost> {};

TEST_P(DiagnoseWithLess, FindsAGapOnlyWhereThereIsOne) {
  const gap::DiagnoseOptions only =
      Only({"unit_mass", "tip_payload", "bending_stiffness", "gear_presliding", "presliding", "cell_offset"});
  for (const char* effect : {"", "unit_mass scale=1.3"}) {
    DataSet set = Recorded(effect, 4.5);
    for (gap::Run& run : set.runs) GetParam().what(run);
    const Diagnosis d = Diagnose(set, only);
    if (*effect == 0) {
      EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
      continue;
    }
    ASSERT_TRUE(d.verdict == Verdict::kAttributed || d.verdict == Verdict::kAmbiguousGroup) << d.sentence;
    // A payload hangs as a heavier body does.
    for (const auto& cause : d.accepted)
      EXPECT_TRUE(cause.effect == "unit_mass" || cause.effect == "tip_payload") << d.sentence;
    ASSERT_NE(Named(d, "unit_mass"), nullptr);
    EXPECT_NEAR(Named(d, "unit_mass")->parameters.at("scale").value, 1.3, 0.05);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Of, DiagnoseWithLess,
    testing::Values(
        Lost{"rows", LoseRows},
        Lost{"a_cell", [](Run& run) { run.tension_N.col(1).setConstant(std::nan("")); }},
        Lost{"every_cell", [](Run& run) { run.tension_N.setConstant(std::nan("")); }},
        Lost{"an_encoder", [](Run& run) { run.motor_position_rad.col(1).setZero(); }},
        Lost{"an_encoder_for_a_second",
             [](Run& run) { run.motor_position_rad.col(1).segment(3000, 1000).setConstant(std::nan("")); }},
        Lost{"what_was_in_rows",
             [](Run& run) {
               for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                                    &run.tension_N, &run.tip_m, &run.tip_quaternion})
                 values->middleRows(2300, 700).setConstant(std::nan(""));
             }},
        Lost{"most_readings_of_a_cell",
             [](Run& run) {
               for (Eigen::Index i = 0; i < run.tension_N.rows(); ++i) {
                 if (i % 40 != 0) run.tension_N(i, 1) = std::nan("");
               }
             }},
        Lost{"turns_of_encoders",
             [](Run& run) {
               constexpr double kTurn_rad = 2 * std::numbers::pi;
               for (double& x : run.motor_position_rad.col(0)) x = std::remainder(x, kTurn_rad);
               for (double& x : run.motor_position_rad.col(1)) x -= kTurn_rad * std::floor(x / kTurn_rad);
             }},
        // With one kind of motion no tension is recorded beyond that range.
        Lost{"large_torques",
             [](Run& run) { run.torque_actual_Nm = run.torque_actual_Nm.cwiseMin(1.8e-3).eval(); }}),
    [](const auto& lost) { return lost.param.name; });

/// Load cells and shape alone.
void WithoutMotors(Run& run) {
  for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad})
    values->resize(0, 0);
}

/// The bend of the only section instead of the tip's pose: angle and direction of the tip's axis.
void BendForPose(Run& run) {
  const Eigen::Index rows = run.time_s.size();
  run.bending_rad.setConstant(rows, 2, std::nan(""));
  for (Eigen::Index i = 0; i < rows; ++i) {
    const Eigen::Vector4d q = run.tip_quaternion.row(i);
    if (!q.allFinite()) continue;
    const Eigen::Vector3d z = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix().col(2);
    const double side = z.head<2>().norm();
    run.bending_rad.row(i) = (side > 0 ? std::atan2(side, z.z()) / side : 0) * z.head<2>().transpose();
  }
  run.tip_m.resize(0, 0);
  run.tip_quaternion.resize(0, 0);
}

struct Shown {
  const char* name;
  void (*what)(Run&);
  std::vector<const char*> planted;
};

class DiagnoseTensionAgainstShape : public testing::TestWithParam<Shown> {};

// With tensions and shape alone only the body is compared (C4, C5).
TEST_P(DiagnoseTensionAgainstShape, NamesBodyEffectsAndReportsHiddenCuts) {
  const gap::DiagnoseOptions only =
      Only({"bending_stiffness", "tip_payload", "torque_constant", "tendon_stiffness", "cell_drift"});
  for (const char* planted : GetParam().planted) {
    SCOPED_TRACE(planted);
    DataSet set = Recorded(planted, 3.5);
    for (gap::Run& run : set.runs) {
      WithoutMotors(run);
      GetParam().what(run);
    }
    const Diagnosis d = Diagnose(set, only);
    for (const auto& finding : d.location) {
      const bool body = finding.cut == sim::Cut::kShape || finding.cut == sim::Cut::kMotion;
      EXPECT_EQ(finding.measured, body || finding.cut == sim::Cut::kClock) << sim::CutName(finding.cut);
    }
    EXPECT_THAT(
        d.degradations,
        testing::Contains(testing::HasSubstr(
            "can be compared: C0, C4, C5; not C1 (no target torque and no actual torque), C2 (no actual "
            "torque and no motor position), C3 (no motor position), C6 (no actual torque and no motor "
            "position)")));
    EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("no motor positions: motors, gears")));
    if (*planted == 0) {
      EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
      continue;
    }
    ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
    const EffectSetting truth = sim::ParseEffect(planted, Rig());
    EXPECT_EQ(d.accepted[0].effect, truth.name) << d.sentence;
    EXPECT_EQ(First(d), sim::Cut::kShape) << d.sentence;
    const auto& [parameter, value] = truth.values.front();
    EXPECT_NEAR(d.accepted[0].parameters.at(parameter).value, value, 0.05 * value) << d.sentence;
  }
}

INSTANTIATE_TEST_SUITE_P(Of, DiagnoseTensionAgainstShape,
                         testing::Values(Shown{"pose", [](Run&) {}, {"", "tip_payload mass_kg=0.004"}},
                                         Shown{"orientation",
                                               [](Run& run) { run.tip_m.resize(0, 0); },
                                               {"bending_stiffness scale=0.8"}},
                                         Shown{"bending", BendForPose, {"", "bending_stiffness scale=0.8"}}),
                         [](const auto& shown) { return shown.param.name; });

TEST(Diagnose, ShapeWithoutKnownTensionsIsRefused) {
  DataSet set = Recorded("", 1);
  for (gap::Run& run : set.runs) {
    WithoutMotors(run);
    run.tension_N.resize(0, 0);
  }
  try {
    Diagnose(set, {});
    FAIL() << "accepted";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("C4 (no tension or motor position of every tendon)"));
  }
}

// Where all cells fail in one run, the cells of the other runs are still used.
TEST(Diagnose, ARunWithoutCellsDoesNotAffectTheOthers) {
  DataSet set = Recorded("cell_gain where=tendon:2 scale=0.9");
  set.runs[1].tension_N.setConstant(std::nan(""));
  const Diagnosis d = Diagnose(set, Only({"cell_gain", "cell_offset", "tendon_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "cell_gain") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.9, 0.01);
}

TEST(Diagnose, ARunWithoutTorqueDoesNotAffectTheOthers) {
  DataSet set = Recorded("torque_constant scale=0.9");
  set.runs[1].torque_actual_Nm *= 1e3;  // another unit
  const Diagnosis d = Diagnose(set, Only({"torque_constant", "motor_coulomb", "tendon_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "torque_constant") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.9, 0.01);
  EXPECT_THAT(d.degradations, testing::Contains(testing::AllOf(
                                  testing::HasSubstr("the actual torque of tendons 1, 2, 3 has no data"),
                                  testing::HasSubstr("(triangle)"))));
}

// After lost rows, and where a run begins in motion, the state of body and friction is unknown until the body
// has settled and every tendon has slid; a motor that started from rest within lost rows is taken to have
// moved in one direction: no gap.
TEST(Diagnose, LostRowsAloneAreNoGap) {
  const std::vector<std::string> families{"circle", "triangle", "multisine", "circle"};
  const std::vector<std::function<void(gap::Run&)>> losses{
      [](gap::Run& run) {
        Lose(run, 450, run.time_s.size() / 3);
        Lose(run, 150, 3000);
      },
      [](gap::Run& run) { Lose(run, 400, 350); },
      [](gap::Run& run) { Lose(run, 1000, 0); },
      [](gap::Run& run) {  // others whole
        if (run.name == "circle") Lose(run, 2500, 0);
      },
  };
  for (const std::size_t seed : {11, 50}) {
    const DataSet before_pulleys = Recorded(std::vector<std::string>{}, 4.5, seed);
    DataSet no_cells = before_pulleys;
    for (gap::Run& run : no_cells.runs) run.tension_N.setConstant(std::nan(""));
    const DataSet behind_pulleys = RecordedAtRobotSide("", families, 4.5, seed);
    for (const DataSet& whole : {before_pulleys, behind_pulleys, no_cells}) {
      for (std::size_t k = seed % 2; k < losses.size(); k += 2) {  // half of them with either seed
        DataSet set = whole;
        for (gap::Run& run : set.runs) losses[k](run);
        const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "presliding"}));
        EXPECT_EQ(d.verdict, Verdict::kNoGap) << "seed " << seed << ", loss " << k << ": " << d.sentence;
        EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("after lost samples")));
      }
    }
  }
}

// A cell at the end of its range is no gap: the tension beyond it follows from the tendon's stretch, not from
// a straight line.
TEST(Diagnose, AClippedCellIsNoGap) {
  DataSet whole = Recorded("", 4);
  whole.runs.push_back(Record(Rig(), "sway", 4, 31));
  for (const double most_N : {2.5, 4.0}) {
    DataSet set = whole;
    for (gap::Run& run : set.runs) run.tension_N.col(0) = run.tension_N.col(0).cwiseMin(most_N).eval();
    const Diagnosis d = Diagnose(set, Only({"bending_damping", "cell_gain"}));
    EXPECT_EQ(d.verdict, Verdict::kNoGap) << most_N << ": " << d.sentence;
    EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("is clipped at")));
  }
}

// A table of two decimal places, which are fewer than cells and encoders have.
TEST(Diagnose, FewDecimalPlacesAreNoGap) {
  DataSet set = Recorded("");
  for (gap::Run& run : set.runs) {
    for (auto* values : {&run.tension_N, &run.motor_position_rad})
      *values = ((*values * 100).array().round() / 100).matrix().eval();
  }
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "tendon_stiffness", "pulley_coulomb"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
}

// A log that keeps every n-th row of the controller's, in which motors seem to respond without delay.
TEST(Diagnose, EveryNthRowIsNoGap) {
  for (const int n : {2, 3, 5}) {
    DataSet set = Recorded("");
    for (gap::Run& run : set.runs) {
      const auto rows = Eigen::seq(n / 2, run.time_s.size() - 1, n);
      run.time_s = run.time_s(rows).eval();
      for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                           &run.tension_N, &run.tip_m, &run.tip_quaternion})
        *values = (*values)(rows, Eigen::all).eval();
    }
    const Diagnosis d = Diagnose(set, Only({"command_delay", "bending_stiffness"}));
    EXPECT_EQ(d.verdict, Verdict::kNoGap) << n << ": " << d.sentence;
    EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("targets sent")));
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

// Rows without any reading are not a failure of each sensor.
TEST(Diagnose, EmptyRowsAreLostRows) {
  DataSet set = Recorded("");
  for (gap::Run& run : set.runs) {
    for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                         &run.tension_N, &run.tip_m, &run.tip_quaternion})
      values->middleRows(3000, 400).setConstant(std::nan(""));
  }
  const Diagnosis d = Diagnose(set, Only({"motor_coulomb", "bending_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("after lost samples")));
  EXPECT_THAT(d.degradations, testing::Each(testing::Not(testing::HasSubstr("has no data"))));
}

// A torque at the drive's limit is not a clipped reading, however constant it is.
TEST(Diagnose, ATorqueThatSaturatesIsSeen) {
  RobotParameters plant = Rig();
  for (auto& tendon : plant.actuation->tendons) tendon.drive.actual_torque_noise_permille = 0;
  plant.effects.push_back(sim::ParseEffect("torque_saturation where=tendon:1 deficit_Nm=0.0065", plant));
  DataSet set = Recorded("");
  for (gap::Run& run : set.runs) {
    const std::string name = run.name, repeat_of = run.repeat_of;
    run = Record(plant, run.family, 7, 11);
    run.name = name;
    run.repeat_of = repeat_of;
  }
  const Diagnosis d =
      Diagnose(set, Only({"torque_saturation", "torque_loop_lag", "torque_constant", "motor_coulomb"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "torque_saturation") << d.sentence;
}

// Time stamps with a date are coarse, and their steps add up.
TEST(Diagnose, TimesSinceAnEpochAreNoGap) {
  DataSet set = Recorded("");
  for (gap::Run& run : set.runs) run.time_s.array() += 1.7e9;
  const Diagnosis d = Diagnose(set, Only({"unit_mass"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  for (const auto& finding : d.location)
    EXPECT_FALSE(finding.cut == sim::Cut::kClock && finding.excess) << finding.rms;
}

struct MadeMistake {
  std::function<void(gap::Run&)> what;
  const char* message;
};

// A wrong sign, order or side causes a gap larger than effects do; undoing it removes the gap.
TEST(Diagnose, MistakesOfMeasurementAreNamed) {
  const DataSet right = Recorded("", 3);
  const MadeMistake mistakes[] = {
      {[](gap::Run& run) { run.motor_position_rad.col(1) *= -1; }, "the sign of motor position 2 reversed"},
      {[](gap::Run& run) {
         for (auto* values :
              {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N})
           values->col(0).swap(values->col(2));
       },
       "all columns of tendons 1 and 3 exchanged"},
      {[](gap::Run& run) { run.tip_m.col(0) *= -1; }, "the sign of tip x reversed"},
      {[](gap::Run& run) { run.tip_m.col(0).swap(run.tip_m.col(1)); }, "tip x and y exchanged"},
      {[](gap::Run& run) {
         run.tip_quaternion = run.tip_quaternion(Eigen::all, {1, 2, 3, 0}).eval();
       },
       "the tip's quaternions read as x, y, z, w"},
      {[](gap::Run& run) { run.load_cell = LoadCellPlace::kRobotSide; },
       "the load cells on the motors' side"},
  };
  for (const MadeMistake& made : mistakes) {
    DataSet set = right;
    for (gap::Run& run : set.runs) made.what(run);
    const Diagnosis d = Diagnose(set, Only({"unit_mass"}));
    EXPECT_THAT(d.sentence,
                testing::StartsWith(std::string("Check the measurement first: with ") + made.message));
    EXPECT_NE(d.degradations.front().find(made.message), std::string::npos) << d.degradations.front();
  }
  // Not even where one run has no tracker.
  DataSet untracked = right;
  for (gap::Run& run : untracked.runs) run.motor_position_rad.col(1) *= -1;
  untracked.runs[0].tip_m.resize(0, 0);
  untracked.runs[0].tip_quaternion.resize(0, 0);
  const std::string message = Diagnose(untracked, Only({"unit_mass"})).sentence;
  EXPECT_NE(message.find("the sign of motor position 2 reversed"), std::string::npos) << message;
  // An effect is not a measurement error, however large.
  const Diagnosis d = Diagnose(Recorded("bending_stiffness scale=0.5", 4), Only({"bending_stiffness"}));
  EXPECT_EQ(d.sentence.find("Check the measurement"), std::string::npos) << d.sentence;
}

// An effect that the robot file contains may have become larger since, or have been removed.
TEST(Diagnose, ALawOfTheRobotFileIsFoundWithMoreAndWithLess) {
  for (const double rad : {0.0, 0.2}) {
    DataSet set = Recorded(rad > 0 ? fmt::format("backlash where=tendon:2 rad={}", rad) : "", 5);
    set.robot.effects.push_back(sim::ParseEffect("backlash where=tendon:2 rad=0.1", set.robot));
    set.robot.effects.push_back(sim::ParseEffect("unit_mass scale=1.0001", set.robot));
    const Diagnosis d = Diagnose(set, Only({"backlash", "encoder_offset", "tendon_stiffness", "unit_mass"}));
    ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
    EXPECT_EQ(d.accepted[0].effect, "backlash");
    EXPECT_EQ(d.accepted[0].where, "tendon:2");
    EXPECT_FALSE(d.accepted[0].bound_hit);
    EXPECT_NEAR(d.accepted[0].parameters.at("rad").value, rad, 0.005) << d.sentence;
    EXPECT_THAT(d.sentence, testing::HasSubstr("where the robot file has 5.7"));
    EXPECT_THAT(d.robot_yaml, testing::HasSubstr("unit_mass"));  // as it was given
  }
}

// A wrong direction of gravity in the robot file, and a wrong scale of the tracker.
TEST(Diagnose, GravityAndScaleAreNamed) {
  DataSet set = Recorded("", 3);
  set.robot.body.gravity_W_mps2 *= -1;
  EXPECT_THAT(Diagnose(set, Only({"unit_mass", "tip_force"})).sentence,
              testing::StartsWith("Check the measurement first: with gravity along -z of the base"));
  set = Recorded("", 3);
  for (gap::Run& run : set.runs) run.tip_m *= 1.03;
  EXPECT_THAT(Diagnose(set, Only({"unit_mass", "tracker_offset"})).sentence,
              testing::ContainsRegex(
                  "^Check the measurement first: with the tip's distances (2.[789]|3|3.1) % smaller"));
}

/// A number of the robot file, `factor` times what it is.
struct WrongNumber {
  const char* key;
  double factor;
  void (*change)(RobotParameters& robot, double factor);
  std::vector<std::string> effects;  // of the library that come near to it
  double within = 0.01;              // of the value found
};

class DiagnoseWrongFile : public testing::TestWithParam<WrongNumber> {};

// A number that is wrong by more than its effect's range, or that no effect represents, is named first with
// the value that fits the runs; no cause is likelier than not.
TEST_P(DiagnoseWrongFile, TheNumberIsReportedFirst) {
  DataSet set = Recorded("", 3);
  GetParam().change(set.robot, GetParam().factor);
  const Diagnosis d = Diagnose(set, Only(GetParam().effects));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_THAT(d.sentence, testing::StartsWith("Check the robot file first: with "));
  for (const auto& cause : d.causes) {
    if (cause.effect != "unknown") {
      EXPECT_LE(cause.p, 0.5) << cause.effect;
    }
  }
  const auto named = std::find_if(d.suspected.begin(), d.suspected.end(),
                                  [](const auto& number) { return number.key == GetParam().key; });
  ASSERT_NE(named, d.suspected.end()) << d.sentence;
  EXPECT_NEAR(named->value / (named->in_file / GetParam().factor), 1, GetParam().within) << d.sentence;
  ASSERT_TRUE(named->closed);
  EXPECT_GT(named->closed->value, 0.99);
}

INSTANTIATE_TEST_SUITE_P(
    Numbers, DiagnoseWrongFile,
    testing::Values(WrongNumber{"body.sections.tendons.radius_m",
                                1.5,
                                [](RobotParameters& robot, double factor) {
                                  for (auto& tendon : robot.body.sections[0].tendons)
                                    tendon.radius_m *= factor;
                                },
                                {"hole_radius", "tendon_stiffness", "bending_stiffness", "unit_stiffness"}},
                    WrongNumber{"actuation.gear.ratio",
                                16.0 / 19,
                                [](RobotParameters& robot, double factor) {
                                  for (auto& tendon : robot.actuation->tendons) tendon.gear.ratio *= factor;
                                },
                                {"torque_constant", "tendon_stiffness", "gear_efficiency"}},
                    // A diameter taken for the radius.
                    WrongNumber{"actuation.spool.radius_m",
                                2,
                                [](RobotParameters& robot, double factor) {
                                  for (auto& tendon : robot.actuation->tendons)
                                    tendon.spool.radius_m *= factor;
                                },
                                {"torque_constant", "spool_growth", "tendon_stiffness"}},
                    WrongNumber{"body.sections.core_radius_m",
                                0.5,
                                [](RobotParameters& robot, double factor) {
                                  robot.body.sections[0].core_radius_m *= factor;
                                },
                                {"bending_stiffness", "tip_force", "tracker_offset"}},
                    // A backbone sixteen times too stiff hardly bends, and does not ring.
                    WrongNumber{"body.sections.core_radius_m",
                                2,
                                [](RobotParameters& robot, double factor) {
                                  robot.body.sections[0].core_radius_m *= factor;
                                },
                                {"bending_stiffness", "tip_force", "tendon_stiffness"}},
                    // Newtons per millimetre taken for newtons per metre. Slack, which stiff tendons turn
                    // into a gap, closes as much as softer ones at the bound of the library's range.
                    WrongNumber{"actuation.tendon.stiffness_Npm",
                                1000,
                                [](RobotParameters& robot, double factor) {
                                  for (auto& tendon : robot.actuation->tendons)
                                    tendon.tendon.stiffness_Npm *= factor;
                                },
                                {"slack", "tendon_stiffness", "encoder_offset"},
                                0.2},
                    WrongNumber{
                        "body.gravity_W_mps2",
                        1.5,
                        [](RobotParameters& robot, double factor) { robot.body.gravity_W_mps2 *= factor; },
                        {"tip_force", "unit_stiffness", "base_tilt"}}),
    [](const auto& about) {
      std::string name = fmt::format("{}_{:.2g}", about.param.key, about.param.factor);
      for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
      return name;
    });

// Angles computed with a wrong number of counts per turn.
TEST(Diagnose, WrongCountsPerTurnAreReportedFirst) {
  DataSet set = Recorded("", 3);
  for (gap::Run& run : set.runs)
    run.motor_position_rad *= 0.5;  // 1024 of the encoder where the file has 2048
  const Diagnosis d = Diagnose(set, Only({"torque_constant", "tendon_stiffness", "hole_radius"}));
  EXPECT_THAT(d.sentence, testing::ContainsRegex(
                              "^Check the robot file first: with "
                              "actuation.drive.encoder_counts_per_turn 102[3-5] where the file has 2048"));
}

// A cause that leaves more than a tenth of the gap is not established, however much worse the others fit.
TEST(Diagnose, ACauseThatLeavesMuchIsNotEstablished) {
  DataSet set =
      Recorded(std::vector<std::string>{"routing_friction mu=0.2", "backlash where=all rad=0.3"}, 4);
  const Diagnosis d = Diagnose(set, Only({"routing_friction"}));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_THAT(d.sentence,
              testing::StartsWith("No cause is established: the likeliest is routing_friction, but "));
  EXPECT_FALSE(d.doubt.empty());
  ASSERT_NE(Named(d, "routing_friction"), nullptr);
  EXPECT_LE(Named(d, "routing_friction")->p, 0.5);
}

// Encoders that count from their position at power-on.
TEST(Diagnose, MotorsZeroedBeforeEachRunAreNamed) {
  DataSet set = Recorded("", 3);
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    for (int j = 0; j < 3; ++j)
      set.runs[i].motor_position_rad.col(j).array() += 0.4 * std::sin(1.0 + 3.0 * static_cast<double>(i) + j);
  }
  EXPECT_THAT(Diagnose(set, Only({"unit_mass", "bending_stiffness"})).sentence,
              testing::StartsWith("Check the measurement first: with the motor positions counted from the "
                                  "beginning of each run"));
}

// A logger faster than a sensor repeats its last reading, or interpolates.
TEST(Diagnose, SensorsSlowerThanTheLogAreNoGap) {
  // Keeps every tenth row of these columns and fills the others.
  const auto fill = [](Eigen::Ref<Eigen::MatrixXd> values, bool line) {
    const Eigen::Index last = (values.rows() - 1) / 10 * 10;
    for (Eigen::Index i = 0; i < values.rows(); ++i) {
      const Eigen::Index a = i / 10 * 10;
      const double share = line && a < last ? static_cast<double>(i - a) / 10 : 0;
      if (i != a)
        values.row(i) = values.row(a) + share * (values.row(std::min(a + 10, last)) - values.row(a));
    }
  };
  const DataSet right = Recorded("", 3);
  for (const bool line : {false, true}) {
    DataSet set = right;
    for (gap::Run& run : set.runs) {
      fill(run.tip_m, line);
      fill(run.tip_quaternion, line);
      fill(run.tension_N, line);
    }
    const Diagnosis d = Diagnose(set, Only({"tip_payload", "cell_gain"}));
    EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
    EXPECT_EQ(d.sentence.find("repetitions differ"), std::string::npos) << d.sentence;
    EXPECT_THAT(
        d.degradations,
        testing::Contains(testing::AllOf(
            testing::HasSubstr(line ? "interpolates between" : "repeats the last one between"),
            testing::HasSubstr("tension 2 (every 10 rows), tension 3 (every 10 rows), the tip (every 10 "
                               "rows)"))));
  }
  // A gap of the same size is still found.
  DataSet heavy = Recorded("tip_payload mass_kg=0.0015", 4);
  const Diagnosis as_recorded = Diagnose(heavy, Only({"tip_payload", "cell_gain"}));
  for (gap::Run& run : heavy.runs) {
    fill(run.tip_m, true);
    fill(run.tip_quaternion, true);
  }
  const Diagnosis filled = Diagnose(heavy, Only({"tip_payload", "cell_gain"}));
  ASSERT_EQ(as_recorded.verdict, Verdict::kAttributed) << as_recorded.sentence;
  ASSERT_EQ(filled.verdict, Verdict::kAttributed) << filled.sentence;
  EXPECT_NEAR(filled.accepted[0].parameters.at("mass_kg").value,
              as_recorded.accepted[0].parameters.at("mass_kg").value, 1e-4);
}

// A cell that is read three times in ten rows is not synchronous with the log: each reading is stored in the
// next row.
TEST(Diagnose, CellsWithTheirOwnRateAreNoGap) {
  DataSet set = Recorded("", 4);
  for (gap::Run& run : set.runs) {
    const Eigen::MatrixXd all = run.tension_N;
    for (Eigen::Index i = 0; i < all.rows(); ++i) {
      const auto reading = static_cast<Eigen::Index>(std::floor(static_cast<double>(i) * 0.3));
      // The reading of the row nearest to its sampling time, repeated from the row after that on.
      run.tension_N.row(i) = all.row(std::min(all.rows() - 1, (10 * reading + 1) / 3));
    }
  }
  const Diagnosis d = Diagnose(set, Only({"tip_payload", "cell_offset"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("tension 1 (every 3 rows)")));
}

// In a table of few decimal places a rounding error lasts for as long as nothing moves.
TEST(Diagnose, CoarseTablesAreNoGap) {
  const auto round = [](Eigen::MatrixXd& values, double step) {
    for (double& x : values.reshaped()) x = step * std::round(x / step);
  };
  DataSet set = Recorded("", 4);
  for (gap::Run& run : set.runs) {
    round(run.tension_N, 0.1);
    round(run.tip_m, 1e-3);
    round(run.tip_quaternion, 0.01);
    run.tip_quaternion_step = 0.01;
  }
  const Diagnosis d = Diagnose(set, Only({"tip_payload", "cell_offset"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations, testing::Not(testing::Contains(testing::HasSubstr("clipped"))));
}

// A delay of one bus cycle is enough for a gap, though a small one.
TEST(Diagnose, CellsACycleLateAreNamed) {
  DataSet set = Recorded("", 4);
  for (gap::Run& run : set.runs) {
    const Eigen::Index rows = run.tension_N.rows();
    run.tension_N.bottomRows(rows - 2) = run.tension_N.topRows(rows - 2).eval();
  }
  const Diagnosis d = Diagnose(set, Only({"tip_payload", "cell_offset"}));
  // In these motions a delay and a filter of a few milliseconds are indistinguishable.
  EXPECT_THAT(d.sentence,
              testing::ContainsRegex("^Check the measurement first: with (the load cells' readings shifted "
                                     "[123] ms earlier|a low-pass filter of [123] ms removed)"));
}

// The same for the delay of a filter or an amplifier.
TEST(Diagnose, SlowCellsAreNamed) {
  DataSet set = Recorded("", 4);
  for (gap::Run& run : set.runs) {
    for (Eigen::Index i = 1; i < run.tension_N.rows(); ++i)
      run.tension_N.row(i) =
          run.tension_N.row(i - 1) + (run.tension_N.row(i) - run.tension_N.row(i - 1)) / 50;
  }
  const std::string filtered = Diagnose(set, Only({"unit_mass"})).sentence;
  EXPECT_THAT(filtered,
              testing::ContainsRegex("with a low-pass filter of (4.|5.) ms removed from the load cells"));
  set = Recorded("", 4);
  for (gap::Run& run : set.runs) {
    const Eigen::Index rows = run.tension_N.rows();
    run.tension_N.bottomRows(rows - 50) = run.tension_N.topRows(rows - 50).eval();
  }
  const std::string late = Diagnose(set, Only({"unit_mass"})).sentence;
  EXPECT_THAT(late, testing::ContainsRegex("with the load cells' readings shifted (4.|5.) ms earlier"));
  // One cell alone.
  set = Recorded("", 4);
  for (gap::Run& run : set.runs) {
    const Eigen::Index rows = run.tension_N.rows();
    run.tension_N.col(1).tail(rows - 12) = run.tension_N.col(1).head(rows - 12).eval();
  }
  const std::string one = Diagnose(set, Only({"unit_mass"})).sentence;
  EXPECT_THAT(one, testing::ContainsRegex("with the readings of load cell 2 shifted 1[123] ms earlier"));
  // Cells that are slower than the log were not filtered.
  set = Recorded("cell_gain where=tendon:2 scale=0.8", 4);
  for (gap::Run& run : set.runs) {
    for (Eigen::Index i = 0; i < run.tension_N.rows(); ++i) {
      if (i % 10 != 0) run.tension_N.row(i).setConstant(std::nan(""));
    }
  }
  const Diagnosis d = Diagnose(set, Only({"cell_gain", "tendon_stiffness"}));
  EXPECT_EQ(d.sentence.find("Check the measurement"), std::string::npos) << d.sentence;
  EXPECT_EQ(d.runs.size(), set.runs.size());
}

// An error in all runs is no reason to leave out the one that shows it most.
TEST(Diagnose, AnErrorInAllRunsLeavesOutNone) {
  DataSet set = Recorded("", 4);
  set.runs = {Record(Rig(), "rest", 4, 21), Record(Rig(), "rest", 4, 22), set.runs[2]};
  set.runs[1].name = "rest again";
  for (gap::Run& run : set.runs) run.motor_position_rad.col(1) *= -1;
  const Diagnosis d = Diagnose(set, Only({"unit_mass", "bending_stiffness"}));
  EXPECT_EQ(d.runs.size(), 3u) << d.degradations.front();
  EXPECT_THAT(d.sentence, testing::HasSubstr("with the sign of motor position 2 reversed"));
  // Nor are all left out where each has its own.
  set = Recorded("", 4);
  set.runs.resize(3);
  set.runs[0].tip_m.col(0) *= -1;
  set.runs[1].motor_position_rad.col(1) *= -1;
  set.runs[2].torque_actual_Nm.col(1) *= -1;
  EXPECT_EQ(Diagnose(set, Only({"unit_mass", "bending_stiffness"})).runs.size(), 3u);
}

// Repetitions of a run that is left out then repeat the first of them.
TEST(Diagnose, RepetitionsOfARunThatIsLeftOutStayRepetitions) {
  DataSet set = Recorded("", 4);
  set.runs.push_back(Record(Rig(), "circle", 4, 23));
  set.runs.back().name = "circle once more";
  set.runs.back().repeat_of = "circle";
  set.runs[0].motor_position_rad.col(1) *= -1;
  const Diagnosis d = Diagnose(set, Only({"unit_mass", "bending_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  ASSERT_EQ(d.runs.size(), 4u);
  EXPECT_EQ(d.runs[2].repeat_of, "");
  EXPECT_EQ(d.runs[3].repeat_of, "circle again");
}

// A run that was measured differently from the others is no gap of the robot: it is left out and named.
TEST(Diagnose, ARunMeasuredDifferentlyIsLeftOut) {
  const DataSet right = Recorded("", 4);
  const MadeMistake mistakes[] = {
      {[](gap::Run& run) { run.time_s *= 1e3; }, "its time is in milliseconds"},
      {[](gap::Run& run) { run.motor_position_rad.col(1) *= -1; }, "the sign of motor position 2"},
      {[](gap::Run& run) { run.motor_position_rad *= 180 / std::numbers::pi; }, "read as degrees"},
      {[](gap::Run& run) { run.tension_N.col(0).swap(run.tension_N.col(1)); },
       "load cells 1 and 2 exchanged"},
      {[](gap::Run& run) { run.tip_m.col(0) *= -1; }, "the sign of tip x"},
      {[](gap::Run& run) { run.tension_N.col(2).array() += 0.15; }, "the zero of load cell 3 moved by -0.1"},
  };
  std::size_t at = 1;
  for (const MadeMistake& made : mistakes) {
    at = 4 - at;  // a run alone of its kind, and a repetition, which makes the floor
    DataSet set = right;
    made.what(set.runs[at]);
    const Diagnosis d = Diagnose(set, Only({"cell_offset", "bending_stiffness"}));
    EXPECT_EQ(d.verdict, Verdict::kNoGap) << made.message << ": " << d.sentence;
    EXPECT_EQ(d.runs.size(), right.runs.size() - 1) << made.message;
    EXPECT_THAT(d.degradations, testing::Contains(testing::AllOf(testing::HasSubstr("left out"),
                                                                 testing::HasSubstr(right.runs[at].name),
                                                                 testing::HasSubstr(made.message))));
    if (&made != &mistakes[0]) {
      EXPECT_THAT(d.sentence, testing::StartsWith(fmt::format("With 1 of {} runs left out ({}: with ",
                                                              right.runs.size(), right.runs[at].name)));
    }
  }
  // A contact in one run alone is not a measurement error.
  DataSet touched = right;
  RobotParameters plant = Rig();
  plant.effects.push_back(sim::ParseEffect("contact stiffness_Npm=40 gap_m=0.004 angle_rad=-0.5", plant));
  const gap::Run bumped = Record(plant, "triangle", 4, 12);
  touched.runs[1] = bumped;
  const Diagnosis d = Diagnose(touched, Only({"contact", "bending_stiffness"}));
  EXPECT_EQ(d.runs.size(), right.runs.size()) << d.degradations.front();
  EXPECT_NE(d.verdict, Verdict::kNoGap) << d.sentence;
}

// Without cells the cut of the cause is not measured; the place is still that of its tendon.
TEST(Diagnose, WithoutCellsTheGapLiesAtTheTendonThatHasIt) {
  DataSet set = Recorded("backlash where=tendon:3 rad=0.15", 5);
  for (gap::Run& run : set.runs) {
    run.load_cell = LoadCellPlace::kNone;
    run.tension_N.resize(0, 0);
  }
  const Diagnosis d = Diagnose(set, Only({"backlash", "tendon_stiffness", "encoder_offset"}));
  EXPECT_THAT(d.sentence,
              testing::HasSubstr("C2 or beyond (C2 to C5 cannot be told apart by place without load "
                                 "cells; tension, tendon:3); its cause is backlash (tendon:3)"));
}

// A cause that one run shows and the others contradict closes nothing; a run of a changed robot is no
// repetition.
TEST(Diagnose, RunsOfTwoRobotsAreNoProof) {
  RobotParameters plant = Rig();
  plant.effects.push_back(sim::ParseEffect("slack where=tendon:1 m=0.002", plant));
  DataSet set = Recorded("", 4);
  set.runs[2] = Record(plant, "multisine", 4, 13);
  const Diagnosis mixed = Diagnose(set, Only({"tendon_stiffness", "slack", "encoder_offset"}));
  EXPECT_NE(mixed.verdict, Verdict::kAttributed) << mixed.sentence;
  EXPECT_THAT(mixed.degradations, testing::Contains(testing::HasSubstr("multisine: its model error is")));

  // Where few of the runs have it, the sentence says so.
  plant = Rig();
  plant.effects.push_back(sim::ParseEffect("base_tilt x_rad=0.2", plant));
  set.runs[2] = Record(plant, "multisine", 4, 13);
  const Diagnosis tilted = Diagnose(set, Only({"tendon_stiffness", "encoder_offset"}));
  EXPECT_EQ(tilted.verdict, Verdict::kUnexplained) << tilted.sentence;
  EXPECT_THAT(tilted.sentence, testing::HasSubstr("It lies mainly in multisine, with"));

  plant = Rig();
  plant.effects.push_back(sim::ParseEffect("bending_stiffness scale=0.8", plant));
  set = Recorded("", 4);
  set.runs[3] = Record(plant, "circle", 4, 14);
  set.runs[3].name = "circle again";
  set.runs[3].repeat_of = "circle";
  const Diagnosis repeated = Diagnose(set, Only({"unit_mass"}));
  EXPECT_THAT(repeated.degradations,
              testing::Contains(testing::HasSubstr("if anything was changed between them")));
  EXPECT_THAT(repeated.sentence,
              testing::HasSubstr("obot does not repeat at C4 (tip position, section:1): "));
  EXPECT_EQ(repeated.verdict, Verdict::kInsufficientData);
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

TEST(Diagnose, AnEncoderThatFreezesHalfWayIsMaskedThere) {
  DataSet set = Recorded("");
  gap::Run& run = set.runs[2];
  auto motor = run.motor_position_rad.col(1);
  motor.tail(motor.size() / 2).setConstant(motor[motor.size() / 2]);
  const Diagnosis d = Diagnose(set, Only({"tendon_stiffness", "bending_stiffness", "presliding"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_EQ(d.runs.size(), set.runs.size());
  EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("motor position 2 stays at")));
}

// Refused before the search begins, with a gap or without.
TEST(Diagnose, TimeOfAllRunsInMillisecondsIsRefused) {
  for (const char* effect : {"", "bending_stiffness scale=0.5", "torque_constant scale=0.8"}) {
    DataSet set = Recorded(effect);
    for (gap::Run& run : set.runs) run.time_s *= 1e3;
    try {
      Diagnose(set, Only({"bending_stiffness"}));
      FAIL() << "accepted: " << effect;
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("seems to be in milliseconds")) << effect;
      EXPECT_THAT(error.what(), testing::HasSubstr("divide t_s by 1000")) << effect;
    }
  }
}

// A run of states at rest, a second apart, among motions is not a motion with its time in milliseconds.
TEST(Diagnose, StatesBesideMotionsStay) {
  DataSet set = Recorded("", 7);
  gap::Run& run = set.runs[1];
  std::vector<int> rows;
  for (int i = 0; i < 7000; i += 20) rows.push_back(i);
  for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N,
                       &run.tip_m, &run.tip_quaternion})
    *values = (*values)(rows, Eigen::all).eval();
  run.time_s = Eigen::VectorXd::LinSpaced(350, 0, 349);
  EXPECT_EQ(Diagnose(set, Only({"bending_stiffness"})).runs.size(), set.runs.size());
  // Nor is a run of many states in arbitrary order among slower logs.
  set = Recorded("", 7);
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    gap::Run& slow = set.runs[i];
    rows.clear();
    for (int row = 0; row < 7000; row += i == 1 ? 64 : 10) rows.push_back(i == 1 ? row * 3571 % 7000 : row);
    for (auto* values : {&slow.torque_target_Nm, &slow.torque_actual_Nm, &slow.motor_position_rad,
                         &slow.tension_N, &slow.tip_m, &slow.tip_quaternion})
      *values = (*values)(rows, Eigen::all).eval();
    const auto size = static_cast<Eigen::Index>(rows.size());
    slow.time_s = Eigen::VectorXd::LinSpaced(size, 0, static_cast<double>(size - 1) * (i == 1 ? 10 : 0.01));
  }
  EXPECT_EQ(Diagnose(set, Only({"bending_stiffness"})).runs.size(), set.runs.size());
}

// Declared without load cell, or without motor positions where there are cells, a run leaves the others
// theirs.
TEST(Diagnose, MissingColumnsOfARunDoNotAffectTheOthers) {
  DataSet set = Recorded("cell_gain where=tendon:2 scale=0.9");
  set.runs[1].load_cell = LoadCellPlace::kNone;
  set.runs[1].tension_N.resize(0, 0);
  set.runs[2].motor_position_rad.resize(0, 0);
  const Diagnosis d = Diagnose(set, Only({"cell_gain", "cell_offset", "tendon_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "cell_gain") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.9, 0.01);
  EXPECT_EQ(d.runs.size(), set.runs.size());
}

// With little data a second cause gains little; it is accepted because nothing is left with it.
TEST(Diagnose, TwoCausesInTwoShortRuns) {
  DataSet set =
      Recorded(std::vector<std::string>{"bending_stiffness scale=0.95", "motor_coulomb scale=1.2"}, 5);
  set.runs.resize(3);
  set.runs.erase(set.runs.begin() + 1);
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "motor_coulomb", "cell_gain", "unit_mass"}));
  ASSERT_EQ(d.accepted.size(), 2u) << d.sentence;
  for (const char* effect : {"bending_stiffness", "motor_coulomb"})
    EXPECT_NE(Named(d, effect), nullptr) << effect;
}

// Neither of two frictions fits alone, and on held-out motions the misfit of the better one loses more than
// any second cause gains to first order.
TEST(Diagnose, ASecondCauseIsTriedWithAnInaccurateFirst) {
  const Diagnosis d =
      Diagnose(Recorded(std::vector<std::string>{"pulley_coulomb N=0.15", "routing_friction mu=0.05"}, 5),
               Only({"pulley_coulomb", "routing_friction", "capstan_alpha", "wrap_angle"}));
  EXPECT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  ASSERT_EQ(d.accepted.size(), 2u) << d.sentence;
  for (const gap::Cause& cause : d.accepted) {
    const bool coulomb = cause.effect == "pulley_coulomb";
    EXPECT_TRUE(coulomb || cause.effect == "routing_friction") << d.sentence;
    EXPECT_NEAR(cause.parameters.at(coulomb ? "N" : "mu").value, coulomb ? 0.15 : 0.05, 0.003) << d.sentence;
  }
}

// Heavier disks and a mass at the tip look alike without a tracker: whichever is screened as the better, the
// other is fitted too.
TEST(Diagnose, LookAlikesOfTheBestAreFittedAsWell) {
  DataSet set = Recorded("unit_mass scale=1.5");
  for (gap::Run& run : set.runs) {
    run.tip_m.resize(0, 0);
    run.tip_quaternion.resize(0, 0);
  }
  gap::DiagnoseOptions options =
      Only({"unit_mass", "tip_payload", "base_tilt", "bending_stiffness", "tendon_stiffness"});
  options.refits = 1;
  const Diagnosis d = Diagnose(set, options);
  for (const char* effect : {"unit_mass", "tip_payload"}) {
    ASSERT_NE(Named(d, effect), nullptr) << effect;
    EXPECT_THAT(Named(d, effect)->note, testing::Not(testing::HasSubstr("screened only"))) << effect;
  }
}

/// Records the set; the repetition has a force at the tip in addition.
DataSet PushedAgain(const std::string& effect, const std::string& force_N) {
  DataSet set = Recorded(effect, 7);
  RobotParameters pushed = Rig();
  for (const std::string& text : {effect, "tip_force x_N=" + force_N})
    pushed.effects.push_back(sim::ParseEffect(text, pushed));
  gap::Run again = Record(pushed, "circle", 7, 40);
  again.name = set.runs.back().name;
  again.repeat_of = "circle";
  set.runs.back() = std::move(again);
  return set;
}

// With cogging a motor stops at a different angle each time, held by a different torque: that is due to the
// cause and not scatter.
TEST(Diagnose, DifferencesMadeByTheCauseAreNotInTheFloor) {
  const DataSet set = PushedAgain("cogging where=tendon:2 amplitude_Nm=4e-4 phase_rad=0.5", "0.001");
  const Diagnosis d = Diagnose(set, Only({"cogging", "stribeck", "motor_coulomb", "gear_efficiency"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "cogging") << d.sentence;
  EXPECT_EQ(d.accepted[0].where, "tendon:2") << d.sentence;
  EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("as cogging tendon:2 makes them differ")));
}

// The same where runs differ by less than those of a robot that was changed in between.
TEST(Diagnose, SmallDifferencesMadeByTheCauseAreNotInTheFloor) {
  const DataSet set = PushedAgain("cogging where=tendon:2 amplitude_Nm=5e-5 phase_rad=0.5", "0.0003");
  const Diagnosis d = Diagnose(set, Only({"cogging", "stribeck", "motor_coulomb", "gear_efficiency"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "cogging") << d.sentence;
  EXPECT_THAT(d.degradations, testing::Contains(testing::ContainsRegex(
                                  "differ by [2-4]\\..* as cogging tendon:2 makes them differ")));
}

/// Runs of the nominal rig with motor friction that differs by `scatter_Nm` rms from run to run, and
/// additional friction of the second motor at three angles a turn; the first family three times, the
/// repetitions with `push_N` at the tip to one side and the other.
DataSet Rubbed(double scatter_Nm, double peaks_Nm, double push_N, std::uint64_t seed) {
  DataSet set;
  set.robot = Rig();
  for (const char* family : {"slow", "circle", "slow", "slow"}) {
    RobotParameters robot = Rig();
    const auto run = static_cast<int>(set.runs.size());
    if (run > 1) robot.body.tip_force_W_N.x() = run == 2 ? push_N : -push_N;
    const double phase = 1.7 * static_cast<double>(seed++);
    const Rub rub = [&](int j, const sim::TendonState& state, double t) {
      const double more = scatter_Nm * (std::sin(3.1 * t + phase + j) + std::sin(7.3 * t + 2 * phase - j));
      const double peak = j == 1 ? std::exp(4 * (std::cos(3 * state.motor_angle_rad + 0.4) - 1)) : 0;
      return (more + peaks_Nm * peak) * std::tanh(state.motor_velocity_radps / 2);
    };
    sim::Plant plant(robot, {.seed = seed});
    set.runs.push_back(Record(plant, family, run == 1 ? 3 : 13, rub));
    if (run < 2) continue;
    set.runs.back().name = fmt::format("slow {}", run);
    set.runs.back().repeat_of = "slow";
  }
  return set;
}

// Friction with peaks at certain angles makes repetitions differ. The floor from repetitions hides it; its
// dependence on the angle reveals it.
TEST(Diagnose, FrictionThatPeaksAtAnglesDoesNotRepeat) {
  const Diagnosis d = Diagnose(Rubbed(2e-6, 1e-4, 0.01, 3), Only({"motor_coulomb"}));
  ASSERT_TRUE(d.repeatability) << d.sentence;
  EXPECT_EQ(d.repeatability->cut, sim::Cut::kDrivetrain);
  EXPECT_EQ(d.repeatability->where, "tendon:2");
  EXPECT_EQ(d.repeatability->depends_on, "the angle of motor 2, 3 times a turn");
  EXPECT_TRUE(d.repeatability->law);
  EXPECT_LE(d.repeatability->p_value, 0.01);
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("does not repeat at C2 (tension, tendon:2)"));
  EXPECT_THAT(d.sentence, testing::HasSubstr("depends on the angle of motor 2, 3 times a turn"));
  EXPECT_LE(Named(d, "no_gap")->p, 0.5);
}

// Friction that varies a little from run to run is no finding, nor are lost rows, coarse readings and
// commands a cycle late.
TEST(Diagnose, ScatterOfFrictionIsNoGap) {
  DataSet set = Rubbed(1e-5, 0, 0, 5);
  const auto round = [](Eigen::MatrixXd& values, double step) {
    for (double& x : values.reshaped()) x = step * std::round(x / step);
  };
  Lose(set.runs[2], 900, 2000);
  round(set.runs[3].motor_position_rad, 0.01);
  round(set.runs[3].tension_N, 0.02);
  auto& targets = set.runs[3].torque_target_Nm;
  const Eigen::Index rows = targets.rows() - 1;
  targets.topRows(rows) = targets.bottomRows(rows).eval();
  const Diagnosis d = Diagnose(set, Only({"motor_coulomb"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_FALSE(d.repeatability) << d.sentence;
}

/// A run after two seconds of unrecorded co-contraction, and a rest: the friction memories of motors, gears
/// and pulleys begin in a different state.
Run RecordAfterStirring(const std::string& family, double duration_s, std::uint64_t seed) {
  sim::Plant plant(Rig(), {.seed = seed});
  for (int i = 0; i < 3000; ++i) {
    const double more_N = i < 2000 ? 0.2 * std::sin(std::numbers::pi * 1e-3 * i) : 0;
    plant.SetTorque((CommandedTension(family, 0).array() + more_N).matrix() * kTorquePerN);
    plant.Advance(kNsPerMs);
  }
  return Record(plant, family, duration_s);
}

// The friction state at the beginning of a run makes no gap.
TEST(Diagnose, AnotherWayToTheStartRepeats) {
  for (const std::uint64_t seed : {3, 13}) {
    DataSet set = Recorded(std::vector<std::string>{}, 5, seed);
    gap::Run again = RecordAfterStirring("circle", 5, seed + 5);
    again.name = "circle again";
    again.repeat_of = "circle";
    set.runs.back() = std::move(again);
    const Diagnosis d = Diagnose(set, Only({"motor_coulomb", "bending_stiffness", "presliding"}));
    EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
    EXPECT_FALSE(d.repeatability) << d.sentence;
  }
}

// The cogging phases of the motors differ.
TEST(Diagnose, DetentsOfAllMotorsAreFoundEachWithItsPhase) {
  const Diagnosis d =
      Diagnose(Recorded("cogging amplitude_Nm=1.5e-4 phase_rad=0.5 phase_2_rad=1.9 phase_3_rad=-2"),
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

// An external force in one of two repetitions: a scatter that no effect of the library explains may hide an
// effect outside it.
TEST(Diagnose, AnUnlistedEffectMayMakeRunsDiffer) {
  DataSet set = Recorded("", 7);
  RobotParameters pushed = Rig();
  pushed.effects.push_back(sim::ParseEffect("tip_force x_N=0.01", pushed));
  gap::Run again = Record(pushed, "circle", 7, 40);
  again.name = set.runs.back().name;
  again.repeat_of = "circle";
  set.runs.back() = std::move(again);
  const Diagnosis d = Diagnose(set, Only({"backlash", "bending_stiffness", "motor_coulomb"}));
  ASSERT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("repetitions differ by"));
  const double unknown = Named(d, "unknown")->p;
  EXPECT_GE(unknown, 0.15);
  for (const char* effect : {"backlash", "bending_stiffness", "motor_coulomb"}) {
    const gap::Cause* cause = Named(d, effect);
    EXPECT_LE(cause == nullptr ? 0 : cause->p, unknown + 1e-9) << effect;
  }
}

// An hour between two rows is no motion: the run would be simulated through it. Nor are 30,000 years, the
// number of whose samples no integer holds.
TEST(Diagnose, RunsWithAPauseAreLeftOut) {
  DataSet set = Recorded("bending_stiffness scale=0.93");
  for (const auto& [run, pause_s] : {std::pair(1, 3600.0), std::pair(2, 1e12)}) {
    Eigen::VectorXd& time_s = set.runs.at(static_cast<std::size_t>(run)).time_s;
    time_s[time_s.size() - 1] += pause_s;
  }
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "cell_gain"}));
  ASSERT_NE(Named(d, "bending_stiffness"), nullptr) << d.sentence;
  ASSERT_GE(d.degradations.size(), 2u);
  for (const auto& [line, pause] : {std::pair(0, "3600"), std::pair(1, "1e+12")}) {
    const std::string& message = d.degradations[static_cast<std::size_t>(line)];
    EXPECT_NE(message.find("left out: " + set.runs[static_cast<std::size_t>(line) + 1].name),
              std::string::npos)
        << message;
    EXPECT_NE(message.find(fmt::format("with a jump of {} s to ", pause)), std::string::npos) << message;
  }
}

TEST(Diagnose, OneRunIsJudgedOnItsQuartersAndSaysSo) {
  DataSet set = Recorded("bending_stiffness scale=0.93");
  set.runs.resize(1);
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "cell_gain"}));
  EXPECT_EQ(d.held_out_by, "quarters of the runs");
  EXPECT_NE(d.sentence.find("held-out quarters of the runs"), std::string::npos) << d.sentence;
}

// If the only family that reaches the limit is held out, the others do not determine the limit.
TEST(Diagnose, ALimitThatOneKindOfExperimentReachesIsFound) {
  RobotParameters plant = Rig();
  const std::string effect = "torque_saturation where=all deficit_Nm=0.0042";  // at about 6.8 N
  plant.effects.push_back(sim::ParseEffect(effect, plant));
  DataSet set;
  set.name = "test";
  set.robot = Rig();
  set.runs = {Record(plant, "multisine", 7, 1), Record(plant, "multisine", 7, 2),
              Record(plant, "circle", 7, 3)};
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
  const Diagnosis d = Diagnose(Recorded("backlash rad=0.3", 4.5), options);
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  ASSERT_NE(Named(d, "unknown"), nullptr);
  EXPECT_GT(Named(d, "unknown")->p, 0.5);
}

TEST(Diagnose, TheSameForAnyNumberOfThreads) {
  const DataSet set = Recorded("tip_payload mass_kg=0.002", 4);
  gap::DiagnoseOptions one = Only({"tip_payload", "unit_mass", "bending_stiffness", "cell_gain"}), two = one;
  one.threads = 1;
  two.threads = 2;
  Diagnosis a = Diagnose(set, one), b = Diagnose(set, two);
  a.seconds = b.seconds = 0;
  EXPECT_EQ(gap::ReportJson(a), gap::ReportJson(b));
}

TEST(Diagnose, WithoutATrackerTheHiddenCutsAreReported) {
  DataSet set = Recorded("torque_constant scale=0.9", 4);
  for (auto& run : set.runs) {
    run.tip_m.resize(0, 0);
    run.tip_quaternion.resize(0, 0);
  }
  const Diagnosis d = Diagnose(
      set, Only({"torque_constant", "gear_efficiency", "motor_coulomb", "cell_gain", "bending_stiffness"}));
  EXPECT_EQ(First(d), sim::Cut::kDrivetrain);
  ASSERT_FALSE(d.causes.empty());
  EXPECT_EQ(d.causes[0].effect, "torque_constant") << d.sentence;
  bool said = false;
  for (const auto& text : d.degradations) said |= text.find("no tracker") != std::string::npos;
  EXPECT_TRUE(said);
}

// Delay and lag of a torque that changes slowly are the same thing.
TEST(Diagnose, CausesThatTheRunsCannotTellApartAreAGroup) {
  const Diagnosis d =
      Diagnose(Recorded("command_delay s=0.004", 4),
               Only({"command_delay", "torque_loop_lag", "torque_constant", "tracker_delay"}));
  EXPECT_EQ(First(d), sim::Cut::kCurrentLoop) << d.sentence;
  ASSERT_EQ(d.verdict, Verdict::kAmbiguousGroup) << d.sentence;
  ASSERT_NE(Named(d, "command_delay"), nullptr);
  ASSERT_NE(Named(d, "torque_loop_lag"), nullptr);
  EXPECT_EQ(Named(d, "command_delay")->group, 1);
  EXPECT_EQ(Named(d, "torque_loop_lag")->group, 1);
}

TEST(Diagnose, RunsWithHardlyAnyMotionAreInsufficientData) {
  DataSet set;
  set.robot = Rig();
  for (const char* name : {"still", "still again", "still once more"}) {
    set.runs.push_back(Record(Rig(), "rest", 3, set.runs.size() + 1));
    set.runs.back().name = name;
  }
  const Diagnosis d = Diagnose(set, {});
  EXPECT_EQ(d.verdict, Verdict::kInsufficientData) << d.sentence;
}

TEST(Diagnose, RunsOfFewerTendonsAreAnotherRobots) {
  DataSet set = Recorded("", 4);
  set.robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/four_tendon_90mm.yaml");
  EXPECT_THAT([&] { Diagnose(set, {}); }, testing::ThrowsMessage<std::runtime_error>(testing::HasSubstr(
                                              "these runs have 3 tendons, robot 'four_tendon_90mm' has 4")));
}

RobotParameters ShortRig() { return config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml"); }

// A frame that is turned and moved, or not known, changes nothing; nor does a run that hardly moves.
TEST(Diagnose, ATipPathBeyondTheRobotsReachIsTheVerdict) {
  for (const bool moved : {false, true}) {
    DataSet set = Recorded("", 4);
    set.robot = ShortRig();
    set.runs.push_back(Record(Rig(), "gentle", 4, 5));
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
    for (gap::Run& run : set.runs) {
      if (moved) run.tip_m = (run.tip_m * turn.transpose()).rowwise() + Eigen::RowVector3d(0.1, 0, -0.2);
    }
    set.fit_frame = moved;
    const Diagnosis d = Diagnose(set, {});
    EXPECT_EQ(d.verdict, Verdict::kUnexplained);
    EXPECT_THAT(d.sentence, testing::StartsWith("No pose of robot 'rig_60mm' explains"));
    EXPECT_TRUE(d.accepted.empty());
    for (const gap::Cause& cause : d.causes) {
      if (cause.effect == "unknown") continue;
      EXPECT_LE(cause.p, 0.5) << cause.effect;
    }
  }
}

// Numbers that are wrong within their bounds leave poses that explain the path.
TEST(Diagnose, WrongNumbersAreWithinTheRobotsReach) {
  for (const char* effect : {"unit_length scale=1.15", "tracker_offset x_m=0.02 y_m=0 z_m=0.03",
                             "tracker_rotation x_rad=0.4 y_rad=0 z_rad=0", "base_tilt x_rad=0.6 y_rad=0",
                             "precurvature u_rad=0.1 v_rad=0", "tip_payload mass_kg=0.003"}) {
    const std::string name = std::string(effect).substr(0, std::string(effect).find(' '));
    const Diagnosis d = Diagnose(Recorded(effect, 4), Only({name}));
    EXPECT_THAT(d.sentence, testing::Not(testing::HasSubstr("No pose"))) << effect;
    ASSERT_EQ(d.accepted.size(), 1u) << effect << ": " << d.sentence;
    EXPECT_EQ(d.accepted[0].effect, name);
  }
}

// One run that another scale makes impossible is odd; the others move as far and are possible.
TEST(Diagnose, OneImpossibleTipPathIsNotTheRobots) {
  DataSet set = Recorded("bending_stiffness scale=0.9", 4);
  set.runs[1].tip_m *= 1.6;
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "unit_length"}));
  EXPECT_THAT(d.sentence, testing::Not(testing::HasSubstr("No pose")));
}

TEST(Diagnose, LogsWithoutMotorPositionsAndCellsAreRefused) {
  DataSet set = Recorded("", 2);
  for (gap::Run& run : set.runs) {
    run.motor_position_rad.resize(0, 0);
    run.tension_N.resize(0, 0);
    run.load_cell = LoadCellPlace::kNone;
  }
  try {
    Diagnose(set, {});
    FAIL() << "accepted";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("not C1 (no tension or motor position of every tendon)"));
  }
}

}  // namespace
}  // namespace tendril
