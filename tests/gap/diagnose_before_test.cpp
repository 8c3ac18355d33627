// The diagnosis of what changed since runs of the same commands.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rig_runs.h"
#include "tendril/gap/diagnose.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Verdict;

// A robot whose file was always wrong, and a mass added to its tip since: compared with the model alone both
// show, compared with the earlier runs only what changed.
TEST(Diagnose, ModelErrorsOfTheRunsFromBeforeAreSubtracted) {
  const std::vector<std::string> wrong{"bending_stiffness scale=0.85", "motor_coulomb scale=1.4"};
  std::vector<std::string> since = wrong;
  since.push_back("tip_payload mass_kg=0.003");
  const DataSet earlier = Recorded(wrong, 4, 31, 500);
  const gap::DiagnoseOptions few =
      Only({"tip_payload", "unit_mass", "bending_stiffness", "motor_coulomb", "base_tilt", "cell_offset"});

  DataSet same = Recorded(wrong, 4, 41, 500);
  CompareWithBefore(same, earlier);
  ASSERT_EQ(same.runs.size(), 8U);
  const Diagnosis unchanged = Diagnose(same, few);
  EXPECT_EQ(unchanged.verdict, Verdict::kNoGap) << unchanged.sentence;
  ASSERT_EQ(unchanged.runs.size(), 4U);
  EXPECT_EQ(unchanged.runs[0].before, "circle@before");

  DataSet changed = Recorded(since, 4, 51, 500);
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
  const DataSet earlier = Recorded({"bending_stiffness scale=2"}, 4, 31, 500);
  DataSet changed = Recorded({"bending_stiffness scale=2", "tip_payload mass_kg=0.01"}, 4, 51, 500);
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
  DataSet earlier = RecordedAt500Hz("", 4), now = Recorded(std::vector<std::string>{}, 4, 41, 500);
  for (gap::Run& run : now.runs) KeepEveryNth(run, 3);
  CompareWithBefore(now, earlier);
  try {
    const Diagnosis d = Diagnose(now, Only({"tendon_stiffness"}));
    FAIL() << d.sentence;
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("no run is left that can be compared with one from before"));
    EXPECT_THAT(error.what(), testing::HasSubstr("a sample every 0.006 s, and every 0.002 s before"));
  }
}

// Nor can a different motion of the same name.
TEST(Diagnose, ARunFromBeforeOfOtherCommandsIsNotComparedWith) {
  DataSet earlier = RecordedAt500Hz("", 4), now = Recorded(std::vector<std::string>{}, 4, 41, 500);
  earlier.runs[0] = Record(Rig(), "sway", 4, 5, 500);
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
  DataSet earlier = RecordedAt500Hz("", 4);
  const DataSet now = Recorded(std::vector<std::string>{}, 4, 41, 500);
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
  DataSet earlier = RecordedAt500Hz("", 4), now = Recorded(std::vector<std::string>{}, 4, 41, 500);
  earlier.runs[0].torque_target_Nm.resize(0, 0);
  CompareWithBefore(now, earlier);
  const Diagnosis d = Diagnose(now, Only({"tendon_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.degradations, testing::Not(testing::Contains(testing::HasSubstr("left out: "))));
}

// Where an encoder is dead in both runs, their difference hides it.
TEST(Diagnose, ADeadEncoderBeforeAndAfterIsMasked) {
  DataSet earlier = RecordedAt500Hz("", 4), now = Recorded(std::vector<std::string>{}, 4, 41, 500);
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
  DataSet earlier = Recorded(wrong, 4, 31, 500), same = Recorded(wrong, 4, 41, 500);
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

}  // namespace
}  // namespace tendril
