// Mistakes of measurement are named before a cause: signs, units, clocks, frames, zeros.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

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

// A deviation of a few seconds in one run is lost in the scatter of a mean over all runs.
TEST(Diagnose, ABumpedTrackerInOneRunIsAGapThatNothingExplains) {
  DataSet set = RecordedAt500Hz("", 4);
  gap::Run& run = set.runs[1];
  for (Eigen::Index i = RowAt(run, 2); i < run.tip_m.rows(); ++i) run.tip_m(i, 0) += 0.01;
  const Diagnosis d = Diagnose(set, Only({"bending_stiffness", "tip_payload", "cell_gain", "backlash"}));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_EQ(First(d), sim::Cut::kShape);
  EXPECT_GT(d.leftover_sigma, 10);
}

/// The tracker's readings of a run stamped `late_ms` later.
void StampLater(Run& run, int late_ms) {
  const Eigen::Index late = RowAt(run, 1e-3 * late_ms);
  for (Eigen::MatrixXd* m : {&run.tip_m, &run.tip_quaternion}) {
    const Eigen::MatrixXd read = *m;
    m->setConstant(std::nan(""));
    for (Eigen::Index i = 0; i < read.rows(); ++i) {
      if (i + late >= 0 && i + late < read.rows()) m->row(i + late) = read.row(i);
    }
  }
}

// A tracker's computer restarted for each run has a different clock offset each time: in some runs the tip
// moves before the motors.
TEST(Diagnose, ATrackerOnAClockOfItsOwnHidesNoCauseAndIsNone) {
  const auto offset = [](DataSet set) {
    const int late_ms[] = {36, -52, 8, -18};
    for (std::size_t i = 0; i < set.runs.size(); ++i) StampLater(set.runs[i], late_ms[i]);
    return set;
  };
  const auto look_for = Only({"bending_damping", "unit_mass", "tracker_offset", "backlash"});
  const Diagnosis none = Diagnose(offset(RecordedAt500Hz("")), look_for);
  EXPECT_EQ(none.verdict, Verdict::kNoGap) << none.sentence;
  EXPECT_THAT(none.degradations,
              testing::Contains(testing::HasSubstr("the tracker's clock is not the drives'")));
  const Diagnosis damped = Diagnose(offset(RecordedAt500Hz("bending_damping scale=4")), look_for);
  ASSERT_EQ(damped.verdict, Verdict::kAttributed) << damped.sentence;
  EXPECT_EQ(damped.accepted[0].effect, "bending_damping");
  EXPECT_NEAR(damped.accepted[0].parameters.at("scale").value, 4, 0.2);
}

// A delay that all runs share is a finding, not a clock offset.
TEST(Diagnose, ATrackersOwnDelayIsFound) {
  DataSet set = RecordedAt500Hz("");
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
  const Diagnosis d = Diagnose(RecordedAt500Hz("tracker_rotation z_rad=0.2", 3), Only({"tracker_rotation"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("tracker_rotation, z 11.4"));
}

TEST(Diagnose, ColumnsOfAnotherUnitAreLeftOutAndTheRestIsDiagnosed) {
  DataSet set = RecordedAt500Hz("bending_stiffness scale=0.93", 4);
  for (gap::Run& run : set.runs) run.tension_N.col(1) *= 1000 / 9.81;
  const Diagnosis d =
      Diagnose(set, Only({"bending_stiffness", "tip_payload", "cell_gain", "torque_constant"}));
  ASSERT_EQ(d.verdict, Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "bending_stiffness") << d.sentence;
  EXPECT_NEAR(d.accepted[0].parameters.at("scale").value, 0.93, 0.003);
  EXPECT_NE(d.degradations.front().find("tension 2 reaches"), std::string::npos) << d.degradations.front();
}

struct MadeMistake {
  std::function<void(gap::Run&)> what;
  const char* message;
};

// A wrong sign, order or side causes a gap larger than effects do; undoing it removes the gap.
TEST(Diagnose, MistakesOfMeasurementAreNamed) {
  const DataSet right = TwoFamilies("", 2);
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
  const Diagnosis d = Diagnose(TwoFamilies("bending_stiffness scale=0.5", 3), Only({"bending_stiffness"}));
  EXPECT_EQ(d.sentence.find("Check the measurement"), std::string::npos) << d.sentence;
}

// Encoders that count from their position at power-on.
TEST(Diagnose, MotorsZeroedBeforeEachRunAreNamed) {
  DataSet set = RecordedAt500Hz("", 3);
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    for (int j = 0; j < 3; ++j)
      set.runs[i].motor_position_rad.col(j).array() += 0.4 * std::sin(1.0 + 3.0 * static_cast<double>(i) + j);
  }
  EXPECT_THAT(Diagnose(set, Only({"unit_mass", "bending_stiffness"})).sentence,
              testing::StartsWith("Check the measurement first: with the motor positions counted from the "
                                  "beginning of each run"));
}

// A delay of one bus cycle is enough for a gap, though a small one.
TEST(Diagnose, CellsACycleLateAreNamed) {
  DataSet set = RecordedAt500Hz("", 3);
  for (gap::Run& run : set.runs) {
    const Eigen::Index rows = run.tension_N.rows();
    run.tension_N.bottomRows(rows - 1) = run.tension_N.topRows(rows - 1).eval();
  }
  const Diagnosis d = Diagnose(set, Only({"tip_payload", "cell_offset"}));
  // In these motions a delay and a filter of a few milliseconds are indistinguishable.
  EXPECT_THAT(d.sentence,
              testing::ContainsRegex("^Check the measurement first: with (the load cells' readings shifted "
                                     "[123] ms earlier|a low-pass filter of [123] ms removed)"));
}

// The same for the delay of a filter or an amplifier.
TEST(Diagnose, SlowCellsAreNamed) {
  DataSet set = TwoFamilies("", 3);
  for (gap::Run& run : set.runs) {
    for (Eigen::Index i = 1; i < run.tension_N.rows(); ++i)
      run.tension_N.row(i) =
          run.tension_N.row(i - 1) + (run.tension_N.row(i) - run.tension_N.row(i - 1)) / 25;
  }
  const std::string filtered = Diagnose(set, Only({"unit_mass"})).sentence;
  EXPECT_THAT(filtered,
              testing::ContainsRegex("with a low-pass filter of (4.|5.) ms removed from the load cells"));
  set = TwoFamilies("", 3);
  for (gap::Run& run : set.runs) {
    const Eigen::Index rows = run.tension_N.rows();
    run.tension_N.bottomRows(rows - 25) = run.tension_N.topRows(rows - 25).eval();
  }
  const std::string late = Diagnose(set, Only({"unit_mass"})).sentence;
  EXPECT_THAT(late, testing::ContainsRegex("with the load cells' readings shifted (4.|5.) ms earlier"));
  // One cell alone.
  set = TwoFamilies("", 4);
  for (gap::Run& run : set.runs) {
    const Eigen::Index rows = run.tension_N.rows();
    run.tension_N.col(1).tail(rows - 6) = run.tension_N.col(1).head(rows - 6).eval();
  }
  const std::string one = Diagnose(set, Only({"unit_mass"})).sentence;
  EXPECT_THAT(one, testing::ContainsRegex("with the readings of load cell 2 shifted 1[123] ms earlier"));
  // Cells that are slower than the log were not filtered.
  set = TwoFamilies("cell_gain where=tendon:2 scale=0.8", 3);
  for (gap::Run& run : set.runs) {
    for (Eigen::Index i = 0; i < run.tension_N.rows(); ++i) {
      if (i % 5 != 0) run.tension_N.row(i).setConstant(std::nan(""));
    }
  }
  const Diagnosis d = Diagnose(set, Only({"cell_gain", "tendon_stiffness"}));
  EXPECT_EQ(d.sentence.find("Check the measurement"), std::string::npos) << d.sentence;
  EXPECT_EQ(d.runs.size(), set.runs.size());
}

// An error in all runs is no reason to leave out the one that shows it most.
TEST(Diagnose, AnErrorInAllRunsLeavesOutNone) {
  DataSet set = RecordedAt500Hz("", 2.5);
  set.runs = {Record(Rig(), "rest", 2.5, 21, 500), Record(Rig(), "rest", 2.5, 22, 500), set.runs[2]};
  set.runs[1].name = "rest again";
  for (gap::Run& run : set.runs) run.motor_position_rad.col(1) *= -1;
  const Diagnosis d = Diagnose(set, Only({"unit_mass", "bending_stiffness"}));
  EXPECT_EQ(d.runs.size(), 3u) << d.degradations.front();
  EXPECT_THAT(d.sentence, testing::HasSubstr("with the sign of motor position 2 reversed"));
  // Nor are all left out where each has its own.
  set = RecordedAt500Hz("", 2.5);
  set.runs.resize(3);
  set.runs[0].tip_m.col(0) *= -1;
  set.runs[1].motor_position_rad.col(1) *= -1;
  set.runs[2].torque_actual_Nm.col(1) *= -1;
  EXPECT_EQ(Diagnose(set, Only({"unit_mass", "bending_stiffness"})).runs.size(), 3u);
}

// Repetitions of a run that is left out then repeat the first of them.
TEST(Diagnose, RepetitionsOfARunThatIsLeftOutStayRepetitions) {
  DataSet set = RecordedAt500Hz("", 4);
  set.runs.push_back(Record(Rig(), "circle", 4, 23, 500));
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
  const DataSet right = RecordedAt500Hz("", 3);
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
  const gap::Run bumped = Record(plant, "triangle", 3, 12, 500);
  touched.runs[1] = bumped;
  const Diagnosis d = Diagnose(touched, Only({"contact", "bending_stiffness"}));
  EXPECT_EQ(d.runs.size(), right.runs.size()) << d.degradations.front();
  EXPECT_NE(d.verdict, Verdict::kNoGap) << d.sentence;
}

// A cause that one run shows and the others contradict closes nothing; a run of a changed robot is no
// repetition.
TEST(Diagnose, RunsOfTwoRobotsAreNoProof) {
  RobotParameters plant = Rig();
  plant.effects.push_back(sim::ParseEffect("slack where=tendon:1 m=0.002", plant));
  DataSet set = RecordedAt500Hz("", 4);
  set.runs[2] = Record(plant, "multisine", 4, 13, 500);
  const Diagnosis mixed = Diagnose(set, Only({"tendon_stiffness", "slack", "encoder_offset"}));
  EXPECT_NE(mixed.verdict, Verdict::kAttributed) << mixed.sentence;
  EXPECT_THAT(mixed.degradations, testing::Contains(testing::HasSubstr("multisine: its model error is")));

  // Where few of the runs have it, the sentence says so.
  plant = Rig();
  plant.effects.push_back(sim::ParseEffect("base_tilt x_rad=0.2", plant));
  set.runs[2] = Record(plant, "multisine", 4, 13, 500);
  const Diagnosis tilted = Diagnose(set, Only({"tendon_stiffness", "encoder_offset"}));
  EXPECT_EQ(tilted.verdict, Verdict::kUnexplained) << tilted.sentence;
  EXPECT_THAT(tilted.sentence, testing::HasSubstr("It lies mainly in multisine, with"));

  plant = Rig();
  plant.effects.push_back(sim::ParseEffect("bending_stiffness scale=0.8", plant));
  set = RecordedAt500Hz("", 4);
  set.runs[3] = Record(plant, "circle", 4, 14, 500);
  set.runs[3].name = "circle again";
  set.runs[3].repeat_of = "circle";
  const Diagnosis repeated = Diagnose(set, Only({"unit_mass"}));
  EXPECT_THAT(repeated.degradations,
              testing::Contains(testing::HasSubstr("if anything was changed between them")));
  EXPECT_THAT(repeated.sentence,
              testing::HasSubstr("obot does not repeat at C4 (tip position, section:1): "));
  EXPECT_EQ(repeated.verdict, Verdict::kInsufficientData);
}

// Refused before the search begins, with a gap or without.
TEST(Diagnose, TimeOfAllRunsInMillisecondsIsRefused) {
  for (const char* effect : {"", "bending_stiffness scale=0.5", "torque_constant scale=0.8"}) {
    DataSet set = RecordedAt500Hz(effect, 3);
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

}  // namespace
}  // namespace tendril
