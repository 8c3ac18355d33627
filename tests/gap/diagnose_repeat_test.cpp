// Repetitions that differ: noise floor, finding, or the work of the cause itself.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <numbers>
#include <random>

#include "rig_runs.h"
#include "tendril/gap/diagnose.h"
#include "tendril/sim/effects.h"
#include "tendril/sim/plant.h"

namespace tendril {
namespace {

using gap::DataSet;
using gap::Diagnosis;
using gap::Run;
using gap::Verdict;

// The scatter between runs is known from the repeated runs; for a motor at rest in those it is taken from the
// other motors.
TEST(Diagnose, AMotorAtRestInTheRepeatedRunsGetsTheFloorOfTheOthers) {
  DataSet set = RecordedAt500Hz("");
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
  DataSet set = RecordedAt500Hz("", 1);
  const double push_N[] = {0.02, 0.01, 0.03, -0.005};
  for (std::size_t i = 0; i < set.runs.size(); ++i) {
    RobotParameters pushed = Rig();
    pushed.effects.push_back(sim::ParseEffect(fmt::format("tip_force x_N={}", push_N[i]), pushed));
    gap::Run run = Record(pushed, set.runs[i].family, 5, 40 + i, 500);
    run.name = set.runs[i].name;
    run.repeat_of = set.runs[i].repeat_of;
    set.runs[i] = std::move(run);
  }
  const Diagnosis d = Diagnose(set, Only({"tip_force", "bending_stiffness"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.sentence, testing::HasSubstr("repetitions differ by"));
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
  EXPECT_THAT(d.degradations,
              testing::Contains(testing::ContainsRegex(
                  "differ by [2-4](\\.[0-9])? times .* as cogging tendon:2 makes them differ")));
}

/// Additional friction of one motor at angles of its turn.
struct Peaks {
  double torque_Nm = 0;
  int motor = 1;  // from 0
  int per_turn = 3;
  double at_rad = 0.4;
};

/// Runs of the nominal rig with motor friction that differs by `scatter_Nm` rms from run to run, and with
/// `peaks`; the first family three times for `slow_s` each, the repetitions with `push_N` at the tip to one
/// side and the other.
DataSet Rubbed(double scatter_Nm, const Peaks& peaks, double push_N, std::uint64_t seed, double slow_s = 13) {
  DataSet set;
  set.robot = Rig();
  for (const char* family : {"slow", "circle", "slow", "slow"}) {
    RobotParameters robot = Rig();
    const auto run = static_cast<int>(set.runs.size());
    if (run > 1) robot.body.tip_force_W_N.x() = run == 2 ? push_N : -push_N;
    const double phase = 1.7 * static_cast<double>(seed++);
    const Rub rub = [&](int j, const sim::TendonState& state, double t) {
      const double more = scatter_Nm * (std::sin(3.1 * t + phase + j) + std::sin(7.3 * t + 2 * phase - j));
      const double angle_rad = peaks.per_turn * state.motor_angle_rad + peaks.at_rad;
      const double peak = j == peaks.motor ? std::exp(4 * (std::cos(angle_rad) - 1)) : 0;
      return (more + peaks.torque_Nm * peak) * std::tanh(state.motor_velocity_radps / 2);
    };
    sim::Plant plant(robot, {.seed = seed});
    set.runs.push_back(Record(plant, family, run == 1 ? 3 : slow_s, rub, 500));
    if (run < 2) continue;
    set.runs.back().name = fmt::format("slow {}", run);
    set.runs.back().repeat_of = "slow";
  }
  return set;
}

// Friction with peaks at certain angles makes repetitions differ. The floor from repetitions hides it; its
// dependence on the angle reveals it.
TEST(Diagnose, FrictionThatPeaksAtAnglesDoesNotRepeat) {
  const Diagnosis d = Diagnose(Rubbed(2e-6, {.torque_Nm = 1e-4}, 0.01, 3, 10), Only({"motor_coulomb"}));
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
  DataSet set = Rubbed(1e-5, {}, 0, 5);
  const auto round = [](Eigen::MatrixXd& values, double step) {
    for (double& x : values.reshaped()) x = step * std::round(x / step);
  };
  Lose(set.runs[2], RowAt(set.runs[2], 0.9), RowAt(set.runs[2], 2));
  round(set.runs[3].motor_position_rad, 0.01);
  round(set.runs[3].tension_N, 0.02);
  auto& targets = set.runs[3].torque_target_Nm;
  const Eigen::Index rows = targets.rows() - 1;
  targets.topRows(rows) = targets.bottomRows(rows).eval();
  const Diagnosis d = Diagnose(set, Only({"motor_coulomb"}));
  EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
  EXPECT_FALSE(d.repeatability) << d.sentence;
}

// A command, not a test: minutes. Draws motors, angles, sizes and numbers of peaks, and as many robots
// without; all repetitions are pushed to either side. Run it with --gtest_also_run_disabled_tests.
TEST(Diagnose, DISABLED_CampaignOfFrictionPeaks) {
  constexpr int kSets = 12;
  std::mt19937_64 draw(std::random_device{}());
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(draw);
  };
  int hits = 0, false_alarms = 0;
  for (int k = 0; k < 2 * kSets; ++k) {
    const std::uint64_t seed = draw() % 100000;
    const double scatter_Nm = std::exp(within(std::log(1e-6), std::log(1e-5)));
    Peaks peaks{.torque_Nm = std::exp(within(std::log(7e-5), std::log(2e-4))),
                .motor = static_cast<int>(draw() % 3),
                .per_turn = 1 + static_cast<int>(draw() % 6),
                .at_rad = within(-3, 3)};
    const bool planted = k % 2 == 0;
    if (!planted) peaks.torque_Nm = 0;
    const Diagnosis d = Diagnose(Rubbed(scatter_Nm, peaks, 0.01, seed), Only({"motor_coulomb"}));
    const bool law = d.repeatability && d.repeatability->law;
    const bool hit = law && d.repeatability->where == fmt::format("tendon:{}", peaks.motor + 1);
    if (planted ? hit : law) ++(planted ? hits : false_alarms);
    fmt::print(
        "seed {} scatter {:.2g} N m, {}: {}\n", seed, scatter_Nm,
        planted ? fmt::format("{:.2g} N m {} times a turn of motor {}", peaks.torque_Nm, peaks.per_turn,
                              peaks.motor + 1)
                : "none",
        law ? fmt::format("{}, p {:.2g}", d.repeatability->depends_on, d.repeatability->p_value) : "no law");
    std::fflush(stdout);
  }
  fmt::print("{} of {} found, {} false alarms of {}\n", hits, kSets, false_alarms, kSets);
  EXPECT_EQ(false_alarms, 0);
  EXPECT_GE(hits, 0.8 * kSets);
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
  return Record(plant, family, duration_s, nullptr, 500);
}

// The friction state at the beginning of a run makes no gap.
TEST(Diagnose, AnotherWayToTheStartRepeats) {
  for (const std::uint64_t seed : {3, 13}) {
    DataSet set = Recorded(std::vector<std::string>{}, 5, seed, 500);
    gap::Run again = RecordAfterStirring("circle", 5, seed + 5);
    again.name = "circle again";
    again.repeat_of = "circle";
    set.runs.back() = std::move(again);
    const Diagnosis d = Diagnose(set, Only({"motor_coulomb", "bending_stiffness", "presliding"}));
    EXPECT_EQ(d.verdict, Verdict::kNoGap) << d.sentence;
    EXPECT_FALSE(d.repeatability) << d.sentence;
  }
}

// An external force in one of two repetitions: a scatter that no effect of the library explains may hide an
// effect outside it.
TEST(Diagnose, AnUnlistedEffectMayMakeRunsDiffer) {
  DataSet set = RecordedAt500Hz("", 5);
  RobotParameters pushed = Rig();
  pushed.effects.push_back(sim::ParseEffect("tip_force x_N=0.01", pushed));
  gap::Run again = Record(pushed, "circle", 5, 40, 500);
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

}  // namespace
}  // namespace tendril
