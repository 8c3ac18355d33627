// Runs without some of the sensors, and runs too few, too short or too calm.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <numbers>

#include "rig_runs.h"
#include "tendril/gap/diagnose.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Run;
using gap::Verdict;

// A missing sensor neither causes a gap nor hides one that the other sensors show.
struct Lost {
  const char* name;
  std::function<void(Run&)> what;
};

class DiagnoseWithLess : public testing::TestWithParam<Lost> {};

TEST_P(DiagnoseWithLess, FindsAGapOnlyWhereThereIsOne) {
  gap::DiagnoseOptions only =
      Only({"unit_mass", "tip_payload", "bending_stiffness", "gear_presliding", "presliding", "cell_offset"});
  only.menu = {};  // the next experiment is planned with what is missing, too
  for (const char* effect : {"", "unit_mass scale=1.3"}) {
    DataSet set = RecordedAt500Hz(effect, 3.5);
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
        Lost{
            "an_encoder_for_a_second",
            [](Run& run) {
              run.motor_position_rad.col(1).segment(RowAt(run, 2.2), RowAt(run, 1)).setConstant(std::nan(""));
            }},
        Lost{"what_was_in_rows",
             [](Run& run) {
               for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                                    &run.tension_N, &run.tip_m, &run.tip_quaternion})
                 values->middleRows(RowAt(run, 2.3), RowAt(run, 0.7)).setConstant(std::nan(""));
             }},
        Lost{"most_readings_of_a_cell",
             [](Run& run) {
               for (Eigen::Index i = 0; i < run.tension_N.rows(); ++i) {
                 if (i % 20 != 0) run.tension_N(i, 1) = std::nan("");
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
  gap::DiagnoseOptions only =
      Only({"bending_stiffness", "tip_payload", "torque_constant", "tendon_stiffness", "cell_drift"});
  only.menu = {};  // the next experiment is planned with what is missing, too
  for (const char* planted : GetParam().planted) {
    SCOPED_TRACE(planted);
    DataSet set = RecordedAt500Hz(planted, 2.5);
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
  DataSet set = RecordedAt500Hz("cell_gain where=tendon:2 scale=0.9", 4);
  set.runs[1].tension_N.setConstant(std::nan(""));
  const Diagnosis d = Diagnose(set, Only({"cell_gain", "cell_offset", "tendon_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "cell_gain") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.9, 0.01);
}

TEST(Diagnose, ARunWithoutTorqueDoesNotAffectTheOthers) {
  DataSet set = RecordedAt500Hz("torque_constant scale=0.9");
  set.runs[1].torque_actual_Nm *= 1e3;  // another unit
  const Diagnosis d = Diagnose(set, Only({"torque_constant", "motor_coulomb", "tendon_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "torque_constant") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.9, 0.01);
  EXPECT_THAT(d.degradations, testing::Contains(testing::AllOf(
                                  testing::HasSubstr("the actual torque of tendons 1, 2, 3 has no data"),
                                  testing::HasSubstr("(triangle)"))));
}

// Without cells the cut of the cause is not measured; the place is still that of its tendon.
TEST(Diagnose, WithoutCellsTheGapLiesAtTheTendonThatHasIt) {
  DataSet set = RecordedAt500Hz("backlash where=tendon:3 rad=0.15", 5);
  for (gap::Run& run : set.runs) {
    run.load_cell = LoadCellPlace::kNone;
    run.tension_N.resize(0, 0);
  }
  const Diagnosis d = Diagnose(set, Only({"backlash", "tendon_stiffness", "encoder_offset"}));
  EXPECT_THAT(d.sentence,
              testing::HasSubstr("C2 or beyond (C2 to C5 cannot be told apart by place without load "
                                 "cells; tension, tendon:3); its cause is backlash (tendon:3)"));
}

// A run of states at rest, a second apart, among motions is not a motion with its time in milliseconds.
TEST(Diagnose, StatesBesideMotionsStay) {
  DataSet set = RecordedAt500Hz("", 4);
  KeepEveryNth(set.runs[1], 10);
  set.runs[1].time_s = Eigen::VectorXd::LinSpaced(200, 0, 199);
  EXPECT_EQ(Diagnose(set, Only({"bending_stiffness"})).runs.size(), set.runs.size());
  // Nor is a run of many states in arbitrary order among slower logs.
  set = RecordedAt500Hz("", 4);
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    gap::Run& slow = set.runs[i];
    std::vector<Eigen::Index> rows;
    for (int row = 0; row < 2000; row += i == 1 ? 32 : 5) rows.push_back(i == 1 ? row * 1021 % 2000 : row);
    KeepRows(slow, rows);
    const auto size = static_cast<Eigen::Index>(rows.size());
    slow.time_s = Eigen::VectorXd::LinSpaced(size, 0, static_cast<double>(size - 1) * (i == 1 ? 10 : 0.01));
  }
  EXPECT_EQ(Diagnose(set, Only({"bending_stiffness"})).runs.size(), set.runs.size());
}

// Declared without load cell, or without motor positions where there are cells, a run leaves the others
// theirs.
TEST(Diagnose, MissingColumnsOfARunDoNotAffectTheOthers) {
  DataSet set = RecordedAt500Hz("cell_gain where=tendon:2 scale=0.9", 4);
  set.runs[1].load_cell = LoadCellPlace::kNone;
  set.runs[1].tension_N.resize(0, 0);
  set.runs[2].motor_position_rad.resize(0, 0);
  const Diagnosis d = Diagnose(set, Only({"cell_gain", "cell_offset", "tendon_stiffness"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "cell_gain") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.9, 0.01);
  EXPECT_EQ(d.runs.size(), set.runs.size());
}

// An hour between two rows is no motion: the run would be simulated through it. Nor are 30,000 years, the
// number of whose samples no integer holds.
TEST(Diagnose, RunsWithAPauseAreLeftOut) {
  DataSet set = RecordedAt500Hz("bending_stiffness scale=0.93", 4);
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
  DataSet set = RecordedAt500Hz("bending_stiffness scale=0.93", 4);
  set.runs.resize(1);
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "cell_gain"}));
  EXPECT_EQ(d.held_out_by, "quarters of the runs");
  EXPECT_NE(d.sentence.find("held-out quarters of the runs"), std::string::npos) << d.sentence;
}

TEST(Diagnose, WithoutATrackerTheHiddenCutsAreReported) {
  DataSet set = RecordedAt500Hz("torque_constant scale=0.9", 4);
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
  EXPECT_TRUE(d.free_runs.empty()) << "no tip to compare with";
}

TEST(Diagnose, RunsWithHardlyAnyMotionAreInsufficientData) {
  DataSet set;
  set.robot = Rig();
  for (const char* name : {"still", "still again", "still once more"}) {
    set.runs.push_back(Record(Rig(), "rest", 3, set.runs.size() + 1, 500));
    set.runs.back().name = name;
  }
  const Diagnosis d = Diagnose(set, {});
  EXPECT_EQ(d.verdict, Verdict::kInsufficientData) << d.sentence;
}

TEST(Diagnose, LogsWithoutMotorPositionsAndCellsAreRefused) {
  DataSet set = RecordedAt500Hz("", 2);
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
