// Readings that are lost, slow, coarse, clipped or frozen make no gap and hide none.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
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

// A body with little damping amplifies the noise of the cells that drive its replay, in shape and stretch:
// with the cause in the model the floor is higher than with the nominal robot, and nothing is left.
TEST(Diagnose, CellNoiseAmplifiedByAnUnderdampedBodyIsNoGap) {
  const DataSet set =
      RecordedAtRobotSide("bending_damping scale=0.2", {"circle", "triangle", "multisine", "circle"}, 5, 5);
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

TEST(Diagnose, AFrozenCellAndImpossibleValuesDoNotHideTheCause) {
  DataSet set = RecordedAt500Hz("bending_stiffness scale=0.93", 7);
  set.runs[0].tension_N.col(0).tail(2500).setConstant(3);
  set.runs[1].tension_N(1250, 1) = 9999;
  set.runs[1].torque_actual_Nm(1500, 1) = 7;
  set.runs[2].tip_m(1500, 1) = 5;
  for (int i = 50; i < 3500; i += 25) set.runs[2].tension_N(i, 2) = i % 50 ? 0 : -1;
  set.runs[0].motor_position_rad(750, 2) = 1e9;
  set.runs[1].motor_position_rad(500, 0) = 300;
  set.runs[1].motor_position_rad(900, 0) = -300;
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

// A motor that reverses within a few samples, or waits and then steps, is not an encoder error.
TEST(Diagnose, QuickMotionsOfAMotorAreNotOutliers) {
  DataSet set = RecordedAt500Hz("", 3);
  const auto steps = [](Eigen::Index i) { return static_cast<double>(i / 350 % 2); };
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
  KeepEveryNth(run, every);
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

// After lost rows, and where a run begins in motion, the state of body and friction is unknown until the body
// has settled and every tendon has slid; a motor that started from rest within lost rows is taken to have
// moved in one direction: no gap.
TEST(Diagnose, LostRowsAloneAreNoGap) {
  const std::vector<std::string> families{"circle", "triangle", "multisine", "circle"};
  const std::vector<std::function<void(gap::Run&)>> losses{
      [](gap::Run& run) {
        Lose(run, RowAt(run, 0.45), run.time_s.size() / 3);
        Lose(run, RowAt(run, 0.15), RowAt(run, 3));
      },
      [](gap::Run& run) { Lose(run, RowAt(run, 0.4), RowAt(run, 0.35)); },
      [](gap::Run& run) { Lose(run, RowAt(run, 1), 0); },
      [](gap::Run& run) {  // others whole
        if (run.name == "circle") Lose(run, RowAt(run, 2.5), 0);
      },
  };
  for (const std::size_t seed : {11, 50}) {
    const DataSet before_pulleys = Recorded(std::vector<std::string>{}, 4.5, seed, 500);
    DataSet no_cells = before_pulleys;
    for (gap::Run& run : no_cells.runs) run.tension_N.setConstant(std::nan(""));
    const DataSet behind_pulleys = RecordedAtRobotSide("", families, 4.5, seed, 500);
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
  DataSet whole = RecordedAt500Hz("", 3);
  whole.runs.push_back(Record(Rig(), "sway", 3, 31, 500));
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
  DataSet set = RecordedAt500Hz("");
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
    for (gap::Run& run : set.runs) KeepEveryNth(run, n, n / 2);
    const Diagnosis d = Diagnose(set, Only({"command_delay", "bending_stiffness"}));
    EXPECT_EQ(d.verdict, Verdict::kNoGap) << n << ": " << d.sentence;
    EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("targets sent")));
  }
}

// Rows without any reading are not a failure of each sensor.
TEST(Diagnose, EmptyRowsAreLostRows) {
  DataSet set = RecordedAt500Hz("");
  for (gap::Run& run : set.runs) {
    for (auto* values : {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad,
                         &run.tension_N, &run.tip_m, &run.tip_quaternion})
      values->middleRows(RowAt(run, 3), RowAt(run, 0.4)).setConstant(std::nan(""));
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
  DataSet set = RecordedAt500Hz("", 1);
  for (gap::Run& run : set.runs) {
    const std::string name = run.name, repeat_of = run.repeat_of;
    run = Record(plant, run.family, 7, 11, 500);
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
  DataSet set = RecordedAt500Hz("");
  for (gap::Run& run : set.runs) run.time_s.array() += 1.7e9;
  const Diagnosis d = Diagnose(set, Only({"unit_mass"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  for (const auto& finding : d.location)
    EXPECT_FALSE(finding.cut == sim::Cut::kClock && finding.excess) << finding.rms;
}

// A logger faster than a sensor repeats its last reading, or interpolates.
TEST(Diagnose, SensorsSlowerThanTheLogAreNoGap) {
  // Keeps every fifth row of these columns and fills the others.
  const auto fill = [](Eigen::Ref<Eigen::MatrixXd> values, bool line) {
    const Eigen::Index last = (values.rows() - 1) / 5 * 5;
    for (Eigen::Index i = 0; i < values.rows(); ++i) {
      const Eigen::Index a = i / 5 * 5;
      const double share = line && a < last ? static_cast<double>(i - a) / 5 : 0;
      if (i != a) values.row(i) = values.row(a) + share * (values.row(std::min(a + 5, last)) - values.row(a));
    }
  };
  const DataSet right = RecordedAt500Hz("", 3);
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
    EXPECT_THAT(d.degradations,
                testing::Contains(testing::AllOf(
                    testing::HasSubstr(line ? "interpolates between" : "repeats the last one between"),
                    testing::HasSubstr("tension 2 (every 5 rows), tension 3 (every 5 rows), the tip (every 5 "
                                       "rows)"))));
  }
  // A gap of the same size is still found.
  DataSet heavy = RecordedAt500Hz("tip_payload mass_kg=0.0015", 4);
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
  DataSet set = RecordedAt500Hz("", 4);
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

TEST(Diagnose, AnEncoderThatFreezesHalfWayIsMaskedThere) {
  DataSet set = RecordedAt500Hz("");
  gap::Run& run = set.runs[2];
  auto motor = run.motor_position_rad.col(1);
  motor.tail(motor.size() / 2).setConstant(motor[motor.size() / 2]);
  const Diagnosis d = Diagnose(set, Only({"tendon_stiffness", "bending_stiffness", "presliding"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_EQ(d.runs.size(), set.runs.size());
  EXPECT_THAT(d.degradations, testing::Contains(testing::HasSubstr("motor position 2 stays at")));
}

}  // namespace
}  // namespace tendril
