// `tendril excite` in process as a user runs it: every experiment, plans, repeats, seeds, limits, wrong use.
#include <cmath>

#include "../gap/cli.h"
#include "tendril/config/config.h"
#include "tendril/gap/data_set.h"

namespace tendril {
namespace {

using gap::DataSet;
using testing::HasSubstr;

class ExciteCommandTest : public CommandTest {
 protected:
  int Excite(const std::string& plan, const std::string& more = "") {
    WriteText(folder_ / "plan.yaml", plan);
    return Run("excite --jobs 1 --plan plan.yaml --out set --overwrite " + more);
  }
  DataSet Load() const { return gap::LoadDataSet(folder_ / "set", ""); }
};

TEST_F(ExciteCommandTest, EveryExperimentLeavesARunFromRest) {
  std::string plan = "runs:\n";
  for (const char* family :
       {"triangle", "cocontraction", "circle", "steps", "multisine", "ladder", "hold", "sway"}) {
    plan += fmt::format("  - {{family: {}, duration_s: {}}}\n", family,
                        std::string(family) == "cocontraction" ? 6 : 4);
  }
  ASSERT_EQ(Excite(plan), 0) << error_;
  const DataSet set = Load();
  ASSERT_EQ(set.runs.size(), 8u);
  const RobotParameters robot = config::LoadRobot(kRig);
  EXPECT_EQ(set.robot.name, robot.name);
  for (const gap::Run& run : set.runs) {
    SCOPED_TRACE(run.name);
    EXPECT_TRUE(run.notes.empty());
    EXPECT_NEAR(run.time_s.tail(1)[0], run.family == "cocontraction" ? 6 : 4, 0.1);
    Eigen::Index still = 0;
    while (run.time_s[still] < 0.5) ++still;
    const auto range = [&](const Eigen::MatrixXd& m, Eigen::Index from, Eigen::Index rows) {
      double widest = 0;
      for (Eigen::Index j = 0; j < m.cols(); ++j) {
        const auto part = m.col(j).segment(from, rows);
        widest = std::max(widest, part.maxCoeff() - part.minCoeff());
      }
      return widest;
    };
    EXPECT_LT(range(run.motor_position_rad, 0, still), 0.02);
    EXPECT_GT(range(run.tension_N, 0, run.tension_N.rows()), 0.3);
    EXPECT_LT(run.tension_N.maxCoeff(), robot.limits.max_tension_motor_N);
    EXPECT_GT(run.tip_m.rows(), 0);
  }
  EXPECT_THAT(out_, HasSubstr("8 runs"));
}

TEST_F(ExciteCommandTest, PrintedPlansCanBeRunAfterEditing) {
  ASSERT_EQ(Run("excite --print-plan quick"), 0);
  std::string plan = out_;
  EXPECT_THAT(plan, HasSubstr("name: quick"));
  // The last run alone.
  const auto first = plan.find("  - {family"), last = plan.rfind("  - {family");
  ASSERT_LT(first, last);
  plan.erase(first, last - first);
  ASSERT_EQ(Excite(plan, "--repeats 1 --seed 4"), 0) << error_;
  const DataSet set = Load();
  ASSERT_EQ(set.runs.size(), 2u);
  EXPECT_EQ(set.runs[1].repeat_of, set.runs[0].name);
  // The same experiment, another noise.
  EXPECT_EQ(set.runs[0].torque_target_Nm, set.runs[1].torque_target_Nm);
  EXPECT_NE(set.runs[0].tension_N, set.runs[1].tension_N);
  ASSERT_EQ(Run("excite --print-plan standard"), 0);
  EXPECT_FALSE(fs::exists(folder_ / "tendril-excite"));
}

TEST_F(ExciteCommandTest, APlantWithEffectsMovesOtherwiseAndTheFolderHoldsTheNominalFile) {
  const std::string plan = "runs: [{family: circle, duration_s: 3}]\n";
  WriteText(folder_ / "real.yaml",
            ReadText(kRig) + "\neffects:\n  - {effect: tip_payload, where: all, mass_kg: 0.01}\n");
  ASSERT_EQ(Excite(plan, "--robot " + kRig), 0) << error_;
  const DataSet nominal = Load();
  ASSERT_EQ(Excite(plan, "--robot " + kRig + " --plant real.yaml"), 0) << error_;
  const DataSet real = Load();
  EXPECT_TRUE(real.robot.effects.empty());
  EXPECT_EQ(real.runs[0].torque_target_Nm.rows(), nominal.runs[0].torque_target_Nm.rows());
  double largest = 0;
  for (Eigen::Index i = 0; i < real.runs[0].tip_m.rows(); ++i) {
    const double moved = (real.runs[0].tip_m.row(i) - nominal.runs[0].tip_m.row(i)).norm();
    if (std::isfinite(moved)) largest = std::max(largest, moved);
  }
  EXPECT_GT(largest, 1e-3);
}

TEST_F(ExciteCommandTest, WhatTheLimitsDoNotAllowIsLessOrRefusedBeforeItRuns) {
  EXPECT_EQ(Excite("runs: [{family: circle, duration_s: 3, amplitude_rad: 12}]\n"), 1);
  EXPECT_THAT(error_, HasSubstr("plan.yaml:1: circle: amplitude_rad is 12; accepted: above 0 to 2.6 rad"));
  // What the robot may bend, but needs more tension than it may have, is cut down to what it may have.
  ASSERT_EQ(Excite("runs: [{family: circle, duration_s: 6, amplitude_rad: 2.6}]\n"), 0) << error_;
  const RobotParameters robot = config::LoadRobot(kRig);
  EXPECT_LT(Load().runs[0].tension_N.maxCoeff(), robot.limits.max_tension_motor_N);
  fs::remove_all(folder_ / "set");
  // Targets of one's own are not changed behind one's back.
  const struct {
    const char *plan, *says;
  } cases[] = {
      {"runs:\n  - family: mine\n    tension_targets: [{t_s: 1, tension_N: [90, 1, 1]}]\n", "tension"},
      {"runs:\n  - family: mine\n    tension_targets: [{t_s: 1, tension_N: [1, 1]}]\n", "3"},
      {"runs:\n  - family: mine\n    bending_targets: [{t_s: 1, bending_rad: [9, 0]}]\n", "bend"},
      {"runs:\n  - family: mine\n    bending_targets: [{t_s: 0.001, bending_rad: [1, 0]}]\n", ""},
  };
  for (const auto& c : cases) {
    const int code = Excite(c.plan);
    if (*c.says) {
      EXPECT_EQ(code, 1) << c.plan;
      EXPECT_THAT(error_, HasSubstr(c.says)) << c.plan;
      EXPECT_TRUE(OneLine());
      EXPECT_FALSE(fs::exists(folder_ / "set/runs.yaml"));
    } else {
      // Too fast a corner is rounded by the controller, or refused; it does not hang or crash.
      EXPECT_TRUE(code == 0 || code == 1) << error_;
    }
  }
}

TEST_F(ExciteCommandTest, WrongUseIsTold) {
  const std::string plan = "runs: [{family: circle, duration_s: 3}]\n";
  const struct {
    std::string more;
    int code;
    const char* says;
  } cases[] = {
      {"--set quick", 2, "--set"},
      {"--seed -1", 2, "leave out the sign"},
      {"--seed 1.5", 2, "accepted: a whole number"},
      {"--jobs 0", 2, "--jobs"},
      {"--repeats 99", 2, "--repeats"},
      {"--arm", 2, "--arm goes with --live"},
      {"--live --plant x.yaml", 2, "--plant is for the plant in this process"},
      {"--live --daemon x.yaml", 2, "--daemon is for the controller in this process"},
      {"--robot gone.yaml", 1, "gone.yaml"},
      {"--plant gone.yaml", 1, "gone.yaml"},
      {"--daemon gone.yaml", 1, "gone.yaml"},
      {fmt::format("--robot {}/config/robots/qi2021_90mm.yaml", TENDRIL_SOURCE_DIR), 1, "has no actuation"},
      {fmt::format("--plant {}/config/robots/four_tendon_90mm.yaml", TENDRIL_SOURCE_DIR), 1, "tendons"},
      {"nonsense", 2, "'nonsense' is not known here"},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(Excite(plan, c.more), c.code) << c.more << error_;
    EXPECT_THAT(error_, HasSubstr(c.says)) << c.more;
  }
  EXPECT_EQ(Run("excite --print-plan longest"), 2);
  EXPECT_EQ(Run("excite --plan gone.yaml"), 1);
  EXPECT_THAT(error_, HasSubstr("gone.yaml: cannot be read"));
  EXPECT_EQ(Excite("runs:\n  - {family: triangel}\n"), 1);
  EXPECT_THAT(error_, HasSubstr("plan.yaml:2: family: there is no experiment 'triangel'"));
  EXPECT_TRUE(OneLine());
  WriteText(folder_ / "robot.yaml",
            ReadText(kRig) + "\neffects:\n  - {effect: backlash, where: all, rad: 7}\n");
  EXPECT_EQ(Excite(plan, "--plant robot.yaml"), 1);
  EXPECT_THAT(error_, testing::ContainsRegex("robot.yaml:[0-9]+: effects"));
}

// Measurements cannot be repeated: without --overwrite a second set does not replace the first, and neither
// does one that fails because no daemon answers.
TEST_F(ExciteCommandTest, TheFirstMeasurementOutlivesTheSecond) {
  WriteText(folder_ / "short.yaml", "runs: [{family: circle, duration_s: 3}]\n");
  ASSERT_EQ(Run("excite --plan short.yaml"), 0) << error_;
  const std::string run = ReadText(folder_ / "tendril-excite/01_circle.csv");
  ASSERT_FALSE(run.empty());
  EXPECT_EQ(Run("excite --plan short.yaml --seed 2"), 2);
  EXPECT_THAT(error_, HasSubstr("tendril-excite already holds a data set"));
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(Run("excite --plan short.yaml --live --lcm memq:// --overwrite"), 1);
  EXPECT_THAT(error_, HasSubstr("no daemon answers"));
  EXPECT_EQ(Run("excite --plan short.yaml --robot gone.yaml --overwrite"), 1);
  EXPECT_EQ(ReadText(folder_ / "tendril-excite/01_circle.csv"), run);
  ASSERT_EQ(Run("excite --plan short.yaml --seed 2 --overwrite"), 0) << error_;
  EXPECT_NE(ReadText(folder_ / "tendril-excite/01_circle.csv"), run);
}

}  // namespace
}  // namespace tendril
