// Two causes at once, and causes that the runs cannot tell apart.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rig_runs.h"
#include "tendril/gap/diagnose.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Verdict;

// Cell noise excites the body in a replay; a body damped more than the real one is excited less and fits
// better, which explains nothing. Gentle runs hardly contradict it.
TEST(Diagnose, ACalmerBodyIsNoSecondCause) {
  const DataSet set = RecordedAtRobotSide("slack where=tendon:3 m=3.3e-5", {"gentle", "gentle"}, 24, 21, 500);
  const Diagnosis d = Diagnose(set, Only({"slack", "bending_damping"}));
  ASSERT_EQ(d.accepted.size(), 1u) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "slack") << d.sentence;
}

// A different spool radius scales the tendon travel per motor angle and nothing else. A smaller pitch circle
// of the tendon holes does so too, with a softer backbone to cancel its influence on the bend. Two errors
// that cancel are less likely than one that is not listed.
TEST(Diagnose, TwoCausesThatCancelAreNotAccepted) {
  DataSet set = RecordedAt500Hz("", 3);
  for (auto& run : set.runs) run.motor_position_rad *= 1.008;
  const auto only = Only({"hole_radius", "bending_stiffness", "unit_mass", "tendon_stiffness", "slack"});
  const Diagnosis allowed = Diagnose(set, only);
  EXPECT_EQ(allowed.verdict, Verdict::kNoGap) << allowed.sentence;  // the file allows another spool
  KnowEveryNumber(set.robot);
  const Diagnosis d = Diagnose(set, only);
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_EQ(First(d), sim::Cut::kTendon) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("cancelled each other at C4, where there is no gap"));
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
  // a residual that a place shows does, where the file does not leave it open.
  DataSet known = Recorded({both[0], "bending_damping scale=2"}, 4, 11, 500);
  KnowEveryNumber(known.robot);
  const Diagnosis plain = Diagnose(known, without);
  ASSERT_TRUE(plain.closed.has_value());
  EXPECT_LT(plain.closed->value, 0.4);
  EXPECT_EQ(plain.verdict, Verdict::kUnexplained) << plain.sentence;
  // A single cause remains a single cause.
  const Diagnosis one = Diagnose(Recorded("command_delay s=0.0015"), only);
  EXPECT_EQ(one.accepted.size(), 1u) << one.sentence;
}

// A cause that leaves more than a tenth of the gap is not established, however much worse the others fit.
TEST(Diagnose, ACauseThatLeavesMuchIsNotEstablished) {
  DataSet set =
      Recorded(std::vector<std::string>{"routing_friction mu=0.2", "backlash where=all rad=0.3"}, 3, 11, 500);
  const Diagnosis d = Diagnose(set, Only({"routing_friction"}));
  EXPECT_EQ(d.verdict, Verdict::kUnexplained) << d.sentence;
  EXPECT_THAT(d.sentence,
              testing::StartsWith("No cause is established: the likeliest is routing_friction, but "));
  EXPECT_FALSE(d.doubt.empty());
  ASSERT_NE(Named(d, "routing_friction"), nullptr);
  EXPECT_LE(Named(d, "routing_friction")->p, 0.5);
}

// With little data a second cause gains little; it is accepted because nothing is left with it.
TEST(Diagnose, TwoCausesInTwoShortRuns) {
  DataSet set = Recorded(std::vector<std::string>{"bending_stiffness scale=0.95", "motor_coulomb scale=1.2"},
                         4, 11, 500);
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
  const Diagnosis d = Diagnose(
      Recorded(std::vector<std::string>{"pulley_coulomb N=0.15", "routing_friction mu=0.05"}, 4, 11, 500),
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
  DataSet set = RecordedAt500Hz("unit_mass scale=1.5", 3);
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

// Delay and lag of a torque that changes slowly are the same thing.
TEST(Diagnose, CausesThatTheRunsCannotTellApartAreAGroup) {
  const Diagnosis d =
      Diagnose(RecordedAt500Hz("command_delay s=0.004", 3),
               Only({"command_delay", "torque_loop_lag", "torque_constant", "tracker_delay"}));
  EXPECT_EQ(First(d), sim::Cut::kCurrentLoop) << d.sentence;
  ASSERT_EQ(d.verdict, Verdict::kAmbiguousGroup) << d.sentence;
  ASSERT_NE(Named(d, "command_delay"), nullptr);
  ASSERT_NE(Named(d, "torque_loop_lag"), nullptr);
  EXPECT_EQ(Named(d, "command_delay")->group, 1);
  EXPECT_EQ(Named(d, "torque_loop_lag")->group, 1);
}

}  // namespace
}  // namespace tendril
