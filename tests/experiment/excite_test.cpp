// Identification experiments: within every limit, still at first, the same again for the same seed, readable
// as data sets; plans read strictly; diagnoses worked into robot files without losing what stands there.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "tendril/config/config.h"
#include "tendril/experiment/excitation.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/gap/data_set.h"
#include "tendril/robot_file/robot_patch.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {
namespace {

namespace fs = std::filesystem;

const std::string kRobots = TENDRIL_SOURCE_DIR "/config/robots/";

std::string ReadText(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

DaemonParameters Daemon() {
  return experiment::ForExperiments(config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml"));
}

experiment::ExperimentOptions Nominal(const std::string& file, std::uint64_t seed) {
  const RobotParameters robot = config::LoadRobot(kRobots + file);
  return {.controller_robot = robot, .plant_robot = robot, .daemon = Daemon(), .seed = seed, .threads = 2};
}

experiment::Plan OnePlan(experiment::PlannedRun run) { return {"one", {std::move(run)}}; }

experiment::PlannedRun Short(const char* family, double duration_s) {
  experiment::PlannedRun run = experiment::UsualRun(family);
  run.duration_s = duration_s;
  return run;
}

// ---- a set as a user gets it ----

class QuickSet : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    options_ = new experiment::ExperimentOptions(Nominal("rig_90mm.yaml", 7));
    set_ = new experiment::ExperimentSet(experiment::RunSet(experiment::QuickPlan(), *options_, nullptr, {}));
  }
  static void TearDownTestSuite() {
    delete set_;
    delete options_;
    set_ = nullptr;
    options_ = nullptr;
  }
  static experiment::ExperimentOptions* options_;
  static experiment::ExperimentSet* set_;
};
experiment::ExperimentOptions* QuickSet::options_ = nullptr;
experiment::ExperimentSet* QuickSet::set_ = nullptr;

TEST_F(QuickSet, StaysWithinEveryLimitAndUsesMostOfTheRange) {
  ASSERT_EQ(set_->trouble, "");
  const LimitParameters& limits = options_->controller_robot.limits;
  double most_N = 0, most_tip_m = 0;
  for (const experiment::Experiment& e : set_->experiments) {
    EXPECT_LT(e.largest_tension_N, limits.max_tension_base_N);
    EXPECT_LE(e.largest_command_N, limits.max_tension_base_N);
    most_N = std::max(most_N, e.largest_tension_N);
  }
  std::set<std::string> families;
  for (const gap::Run& run : set_->data.runs) {
    families.insert(run.family);
    EXPECT_LT(run.tension_N.maxCoeff(), limits.max_tension_motor_N) << run.name;
    for (Eigen::Index i = 0; i < run.tip_m.rows(); ++i) {
      if (run.tip_m.row(i).allFinite()) most_tip_m = std::max(most_tip_m, run.tip_m.row(i).head<2>().norm());
    }
  }
  EXPECT_EQ(families.size(), experiment::Families().size());
  EXPECT_GT(most_N, 4);
  EXPECT_GT(most_tip_m, 0.055) << "of 90 mm: a bend of about 1.5 rad";
  EXPECT_NEAR(set_->simulated_s, 60, 10);
}

TEST_F(QuickSet, EveryRunBeginsStillWhereThePlantBegins) {
  for (const gap::Run& run : set_->data.runs) {
    EXPECT_EQ(run.time_s[0], 0);
    for (Eigen::Index i = 0; run.time_s[i] < experiment::kStillBefore_s; ++i) {
      ASSERT_EQ(run.motor_position_rad.row(i).cwiseAbs().maxCoeff(), 0) << run.name << " row " << i;
      ASSERT_NEAR(run.tension_N.row(i).minCoeff(), 0.3, 0.05);
      ASSERT_NEAR(run.tension_N.row(i).maxCoeff(), 0.3, 0.05);
    }
    EXPECT_GT(run.motor_position_rad.cwiseAbs().maxCoeff(), 1) << run.name << " hardly moves";
  }
}

// The targets are stamped when sent: they act at the next SYNC, then through the lag of 0.5 ms.
TEST_F(QuickSet, ActualTorqueFollowsTheTargetOneCycleLater) {
  const gap::Run& run = set_->data.runs[5];
  const Eigen::VectorXd target = run.torque_target_Nm.col(0), actual = run.torque_actual_Nm.col(0);
  const auto rms_with = [&](Eigen::Index cycles) {
    double expected = actual[0], sum = 0;
    for (Eigen::Index k = 1; k < actual.size(); ++k) {
      expected += ((k - 1 >= cycles ? target[k - 1 - cycles] : actual[0]) - expected) * (1 - std::exp(-2.0));
      if (k > 500) sum += std::pow(actual[k] - expected, 2);
    }
    return std::sqrt(sum / static_cast<double>(actual.size() - 500)) / 7.056e-6;
  };
  EXPECT_LT(rms_with(1), 0.6) << "per mille: noise and rounding only";
  EXPECT_GT(rms_with(0), 1);
  EXPECT_GT(rms_with(2), 1);
}

TEST_F(QuickSet, RepeatsDifferByNoiseOnly) {
  const auto repeat = std::find_if(set_->data.runs.begin(), set_->data.runs.end(),
                                   [](const gap::Run& r) { return !r.repeat_of.empty(); });
  ASSERT_NE(repeat, set_->data.runs.end());
  const auto first = std::find_if(set_->data.runs.begin(), set_->data.runs.end(),
                                  [&](const gap::Run& r) { return r.name == repeat->repeat_of; });
  ASSERT_NE(first, set_->data.runs.end());
  EXPECT_EQ(first->torque_target_Nm, repeat->torque_target_Nm);
  const Eigen::MatrixXd difference = first->tension_N - repeat->tension_N;
  const double rms = std::sqrt(difference.squaredNorm() / static_cast<double>(difference.size()));
  EXPECT_NEAR(rms, 0.0055 * std::sqrt(2), 0.003);  // 5 mN of noise and steps of 5 mN, twice
}

TEST_F(QuickSet, FolderLoadsAgain) {
  const fs::path folder = fs::temp_directory_path() / ("tendril_excite_test_" + std::to_string(getpid()));
  gap::WriteDataSet(set_->data, folder);
  const gap::DataSet again = gap::LoadDataSet(folder, "");
  fs::remove_all(folder);
  ASSERT_EQ(again.runs.size(), set_->data.runs.size());
  for (std::size_t i = 0; i < again.runs.size(); ++i) {
    EXPECT_EQ(again.runs[i].name, set_->data.runs[i].name);
    EXPECT_EQ(again.runs[i].family, set_->data.runs[i].family);
    EXPECT_EQ(again.runs[i].repeat_of, set_->data.runs[i].repeat_of);
    EXPECT_EQ(again.runs[i].tension_N, set_->data.runs[i].tension_N);
  }
  EXPECT_LT(robot_file::RobotDifference(again.robot, options_->controller_robot), 1e-15);
}

TEST(Experiments, SameSeedSameNumbers) {
  const experiment::Plan plan = OnePlan(Short("sway", 4));
  const auto run = [&](std::uint64_t seed, int threads) {
    experiment::ExperimentOptions options = Nominal("rig_90mm.yaml", seed);
    options.threads = threads;
    return experiment::RunSet(plan, options, nullptr, {}).data.runs.at(0);
  };
  const gap::Run a = run(1, 1), b = run(1, 2), c = run(2, 1);
  EXPECT_EQ(a.tension_N, b.tension_N);
  EXPECT_EQ(a.motor_position_rad, b.motor_position_rad);
  EXPECT_EQ(a.torque_target_Nm, c.torque_target_Nm);
  EXPECT_NE(a.tension_N, c.tension_N);
}

// A delay in the robot file is in the logs, as it is in the model that they are compared with.
TEST(Experiments, ATrackersDelayShowsInTheTipAndNowhereElse) {
  experiment::ExperimentOptions options = Nominal("rig_90mm.yaml", 3);
  const experiment::Plan plan = OnePlan(Short("circle", 4));
  const gap::Run prompt = experiment::RunSet(plan, options, nullptr, {}).data.runs.at(0);
  constexpr int kLate = 30;  // rows of 1 ms
  options.plant_robot.actuation->tracker->delay_s = 1e-3 * kLate;
  const gap::Run late = experiment::RunSet(plan, options, nullptr, {}).data.runs.at(0);
  EXPECT_EQ(prompt.motor_position_rad, late.motor_position_rad);
  const auto off = [&](Eigen::Index earlier) {
    double square = 0, count = 0;
    for (Eigen::Index i = 1000; i < late.tip_m.rows(); ++i) {
      if (!late.tip_m.row(i).allFinite()) continue;
      const Eigen::Index then = i - earlier;
      if (!prompt.tip_m.row(then).allFinite()) continue;
      square += (late.tip_m.row(i) - prompt.tip_m.row(then)).squaredNorm() / 3;
      ++count;
    }
    EXPECT_GT(count, 100);
    return std::sqrt(square / count);
  };
  EXPECT_LT(off(kLate), 2 * 5e-5) << "the tracker's noise, twice";
  EXPECT_GT(off(0), 5e-4);
}

// What is simulated can be had again, so that a set holds nothing but whole runs.
TEST(Experiments, StopKeepsTheRunsThatAreWhole) {
  std::atomic<bool> stop = false;
  experiment::Plan plan = OnePlan(Short("sway", 4));
  plan.runs.push_back(Short("hold", 10));
  plan.runs.push_back(Short("circle", 4));
  experiment::ExperimentOptions options = Nominal("rig_90mm.yaml", 1);
  options.threads = 1;
  const experiment::ExperimentSet set = experiment::RunSet(
      plan, options, &stop, [&](std::size_t run, double share, const experiment::Experiment*) {
        if (run == 1 && share > 0.3) stop = true;
      });
  EXPECT_TRUE(set.trouble.starts_with("02_hold: stopped")) << set.trouble;
  ASSERT_EQ(set.data.runs.size(), 1u);
  EXPECT_EQ(set.data.runs[0].family, "sway");
  EXPECT_NEAR(set.data.runs[0].time_s.tail(1)[0], 4, 0.1);
}

// A load cell that shows 2 N too much trips the controller's guard: the run ends there, with its data.
TEST(Experiments, AFaultEndsTheRunWithItsData) {
  experiment::ExperimentOptions options = Nominal("rig_90mm.yaml", 1);
  options.plant_robot.effects.push_back(
      sim::ParseEffect("cell_offset where=tendon:1 N=2", options.plant_robot));
  options.controller_robot.limits.max_tension_motor_N = 5.5;
  options.plant_robot.limits = options.controller_robot.limits;
  const experiment::ExperimentSet set =
      experiment::RunSet(OnePlan(Short("triangle", 8)), options, nullptr, {});
  EXPECT_NE(set.trouble.find("triangle"), std::string::npos);
  ASSERT_EQ(set.data.runs.size(), 1u);
  EXPECT_FALSE(set.data.runs[0].notes.empty());
}

// ---- programs ----

TEST(Programs, FitEveryShippedRig) {
  for (const char* file : {"rig_60mm.yaml", "rig_90mm.yaml", "two_section.yaml", "four_tendon_90mm.yaml"}) {
    const RobotParameters robot = config::LoadRobot(kRobots + file);
    const ControllerParameters controller = Daemon().controller;
    for (const experiment::PlannedRun& run : experiment::QuickPlan().runs) {
      SCOPED_TRACE(std::string(file) + " " + run.family);
      const experiment::Program program = experiment::MakeProgram(run, robot, controller);
      EXPECT_NEAR(program.duration_s(), run.duration_s, 0.02);
      EXPECT_EQ(program.At(0.4).kind, CommandKind::kNone) << "still at first";
      EXPECT_NE(program.At(0.6).kind, CommandKind::kNone);
      const auto& t = program.targets;
      if (program.tension) {
        EXPECT_GE(t.minCoeff(), robot.limits.min_tension_N - 1e-12);
        EXPECT_LE(t.maxCoeff(), robot.limits.max_tension_base_N);
        EXPECT_LT((t.bottomRows(1).array() - robot.limits.min_tension_N).abs().maxCoeff(), 0.5)
            << "let go at the end";
        const Eigen::MatrixXd step = t.bottomRows(t.rows() - 1) - t.topRows(t.rows() - 1);
        EXPECT_LE(step.cwiseAbs().maxCoeff(), controller.pretension_ramp_Nps * program.step_s);
      } else {
        for (Eigen::Index i = 0; i < t.rows(); ++i) {
          for (Eigen::Index k = 0; k < t.cols(); k += 2)
            ASSERT_LE(t.row(i).segment<2>(k).norm(), robot.limits.max_bending_rad);
        }
        EXPECT_LT(t.bottomRows(1).norm(), 1e-9) << "straight at the end";
      }
    }
  }
}

TEST(Programs, AskTheRobotForNoMoreThanItCan) {
  const RobotParameters robot = config::LoadRobot(kRobots + "rig_90mm.yaml");
  RobotParameters weak = robot;
  weak.limits.max_tension_base_N = 2;
  const experiment::Program full =
      experiment::MakeProgram(experiment::UsualRun("triangle"), robot, Daemon().controller);
  const experiment::Program less =
      experiment::MakeProgram(experiment::UsualRun("triangle"), weak, Daemon().controller);
  EXPECT_GT(full.targets.maxCoeff(), 1.4);
  EXPECT_LT(less.targets.maxCoeff(), 0.7) << "a quarter of the tension, a quarter of the bend";
  EXPECT_GT(less.targets.maxCoeff(), 0.2);
}

TEST(Programs, OwnTargetsAreCheckedAgainstTheRobot) {
  const RobotParameters robot = config::LoadRobot(kRobots + "rig_90mm.yaml");
  const auto run = [&](experiment::PlannedRun::Targets kind, std::vector<experiment::Waypoint> waypoints) {
    experiment::PlannedRun r;
    r.family = "mine";
    r.targets = kind;
    r.waypoints = std::move(waypoints);
    return experiment::MakeProgram(r, robot, Daemon().controller);
  };
  using enum experiment::PlannedRun::Targets;
  EXPECT_NEAR(run(kBending, {{1, {0.8, 0}}, {2, {0.8, 0}}}).At(2.0).bending_rad[0], 0.8, 1e-9);
  EXPECT_NEAR(run(kTension, {{1, {2, 1, 1}}}).At(1.5).tension_N[0], 2, 0.02);
  EXPECT_THROW(run(kBending, {{1, {0.8}}}), std::invalid_argument);
  EXPECT_THROW(run(kBending, {{1, {2.5, 0}}}), std::invalid_argument);
  EXPECT_THROW(run(kBending, {{0.05, {0.8, 0}}}), std::invalid_argument) << "too fast";
  EXPECT_THROW(run(kTension, {{1, {9, 1, 1}}}), std::invalid_argument);
  EXPECT_THROW(run(kTension, {{1, {0.1, 1, 1}}}), std::invalid_argument) << "below the least tension";
}

TEST(Programs, MultisinePhasesFollowTheSeed) {
  const RobotParameters robot = config::LoadRobot(kRobots + "rig_90mm.yaml");
  experiment::PlannedRun run = experiment::UsualRun("multisine");
  const auto a = experiment::MakeProgram(run, robot, Daemon().controller).targets;
  EXPECT_EQ(a, experiment::MakeProgram(run, robot, Daemon().controller).targets);
  run.seed = 2;
  EXPECT_NE(a, experiment::MakeProgram(run, robot, Daemon().controller).targets);
}

// ---- plan files ----

TEST(Plans, ComeBackFromTheirText) {
  experiment::Plan plan = experiment::StandardPlan();
  experiment::PlannedRun own;
  own.family = "mine";
  own.repeats = 2;
  own.targets = experiment::PlannedRun::Targets::kTension;
  own.waypoints = {{0.5, {1, 2, 3.25}}, {1.5, {1, 1, 1}}};
  plan.runs.push_back(own);
  const experiment::Plan again = experiment::ParsePlan(ToYaml(plan), "text");
  EXPECT_EQ(ToYaml(again), ToYaml(plan));
  ASSERT_EQ(again.runs.size(), plan.runs.size());
  EXPECT_EQ(again.runs.back().waypoints[0].value, own.waypoints[0].value);
}

TEST(Plans, BadOnesAreRefusedWithLineAndRemedy) {
  const struct {
    const char *text, *line, *says;
  } cases[] = {
      {"runs: []", ":1:", "1 to 100 runs"},
      {"name: x", ":1:", "runs"},
      {"runs:\n  - {family: triangel}", ":2:", "triangle"},
      {"runs:\n  - {family: triangle, amplitude: 1}", ":2:", "amplitude_rad"},
      {"runs:\n  - {family: triangle, amplitude_rad: -1}", ":2:", "0.01"},
      {"runs:\n  - {family: triangle, amplitude_rad: .nan}", ":2:", "number"},
      {"runs:\n  - {family: triangle, duration_s: 1e9}", ":2:", "600"},
      {"runs:\n  - {family: triangle, duration_s: long}", ":2:", "'long'"},
      {"runs:\n  - {family: triangle, repeats: -1}", ":2:", "whole number"},
      {"runs:\n  - {family: triangle, repeats: 1, repeats: 2}", ":2:", "twice"},
      {"runs:\n  - {family: multisine, seed: 99999999999999999999999}", ":2:", "whole number"},
      {"runs:\n  - {duration_s: 5}", ":2:", "family is missing"},
      {"runs:\n  - {family: ../x}", ":2:", "a to z"},
      {"runs:\n  - {family: mine}", ":2:", "bending_targets"},
      {"runs:\n  - family: mine\n    bending_targets: [{t_s: 2, bending_rad: [1, 0]}, {t_s: 1, bending_rad: "
       "[0, 0]}]",
       ":3:", "increase"},
      {"runs:\n  - family: mine\n    bending_targets: [{t_s: 1, tension_N: [1, 0]}]", ":3:", "bending_rad"},
      {"runs:\n  - family: mine\n    duration_s: 5\n    tension_targets: [{t_s: 1, tension_N: [1, 1, 1]}]",
       ":3:", "leave it out"},
      {"runs: [", ":", "not YAML"},
      {"", ":1:", "name and runs"},
  };
  for (const auto& c : cases) {
    try {
      experiment::ParsePlan(c.text, "plan.yaml");
      ADD_FAILURE() << "accepted: " << c.text;
    } catch (const std::runtime_error& e) {
      const std::string what = e.what();
      EXPECT_NE(what.find(std::string("plan.yaml") + c.line), std::string::npos) << what;
      EXPECT_NE(what.find(c.says), std::string::npos) << what;
      EXPECT_EQ(what.find('\n'), std::string::npos) << what;
    }
  }
  EXPECT_THROW(experiment::LoadPlan("/no/such/plan.yaml"), std::runtime_error);
}

// ---- a diagnosis worked into a robot file ----

std::vector<std::string> Comments(const std::string& text) {
  std::vector<std::string> comments;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const auto at = line.find('#');
    if (at == std::string::npos) continue;
    const auto words = line.find_first_not_of("# ", at);
    if (words != std::string::npos) comments.push_back(line.substr(words));
  }
  return comments;
}

EffectSetting Typical(const sim::Effect& effect, const std::string& where, const RobotParameters& robot) {
  EffectSetting setting{.name = std::string(effect.name), .where = where, .values = {}};
  for (const auto& p : sim::ParametersOf(effect, sim::ParseTarget(effect, where, robot), robot)) {
    setting.values.emplace_back(p.name, p.shape ? p.nominal : p.nominal + p.typical);
  }
  return setting;
}

TEST(Patch, EveryEffectOnEveryPlaceReadsBackAsFolded) {
  for (const char* file : {"rig_90mm.yaml", "two_section.yaml"}) {
    const std::string text = ReadText(kRobots + file);
    const RobotParameters robot = config::LoadRobot(kRobots + file);
    for (const sim::Effect& effect : sim::Effects()) {
      // The larger robot adds sections, not laws: a sample of the effects is enough there.
      if (robot.body.sections.size() > 1 && effect.name.size() % 3 != 0) continue;
      std::vector<std::string> places;
      if (effect.on_all) places.push_back("all");
      if (effect.on_one) {
        places.push_back(sim::TargetText(effect, 0));
        places.push_back(sim::TargetText(effect, 1));
      }
      for (const std::string& where : places) {
        RobotParameters wanted = robot;
        try {
          sim::ParseTarget(effect, where, robot);
        } catch (const std::invalid_argument&) {
          continue;  // a section that this robot has not
        }
        SCOPED_TRACE(std::string(file) + " " + std::string(effect.name) + " " + where);
        wanted.effects = {Typical(effect, where, robot)};
        const robot_file::RobotPatch patch = robot_file::PatchRobot(text, file, wanted.effects, {"why"});
        EXPECT_LE(robot_file::RobotDifference(patch.robot, wanted), 1e-9);
        EXPECT_GT(robot_file::RobotDifference(patch.robot, robot), 1e-9) << "nothing was changed";
        // A number that the file has is not left to the list of effects: the controller must know it too.
        EXPECT_EQ(patch.robot.effects.size(), effect.edit ? 0u : 1u);
      }
    }
  }
}

TEST(Patch, PathsThatAFileDrawsWithoutPulleysGetThem) {
  const std::string file = TENDRIL_SOURCE_DIR "/config/import/trunk_payload.yaml";
  const std::string in_lines = ReadText(kRobots + "rig_90mm.yaml");
  const auto from = in_lines.find("    pulleys:\n"), next = in_lines.find("    presliding_m:", from);
  ASSERT_LT(from, next);
  ASSERT_NE(next, in_lines.npos);
  for (const std::string& text :
       {ReadText(file), in_lines.substr(0, from) + "    pulleys: []\n" + in_lines.substr(next)}) {
    for (const char* where : {"all", "tendon:2"}) {
      SCOPED_TRACE(where);
      RobotParameters wanted = config::ParseRobot(text, file);
      wanted.effects = {{.name = "wrap_angle", .where = where, .values = {{"extra_rad", 2}}}};
      const robot_file::RobotPatch patch = robot_file::PatchRobot(text, file, wanted.effects, {"why"});
      EXPECT_LE(robot_file::RobotDifference(patch.robot, wanted), 1e-9);
      const auto& tendons = patch.robot.actuation->tendons;
      EXPECT_EQ(tendons[1].transmission.pulleys.at(0).wrap_rad, 2);
      EXPECT_EQ(tendons[0].transmission.pulleys.size(), std::string(where) == "all" ? 1u : 0u);
    }
  }
}

TEST(Patch, KeepsCommentsOrderAndEverythingElse) {
  const std::string text = ReadText(kRobots + "rig_90mm.yaml");
  const std::vector<EffectSetting> effects{
      {.name = "bending_stiffness", .where = "all", .values = {{"scale", 0.9}}},
      {.name = "torque_constant", .where = "tendon:2", .values = {{"scale", 0.95}}},
      {.name = "tip_payload", .where = "all", .values = {{"mass_kg", 0.002}}},
      {.name = "backlash", .where = "tendon:3", .values = {{"rad", 0.1}}},
  };
  const robot_file::RobotPatch patch =
      robot_file::PatchRobot(text, "rig", effects, {"by the test", "for a reason"});
  const auto before = Comments(text), after = Comments(patch.text);
  std::size_t at = 0;
  for (const std::string& comment : before) {
    const auto found =
        std::find_if(after.begin() + static_cast<std::ptrdiff_t>(at), after.end(), [&](const std::string& c) {
          return c.size() >= comment.size() &&
                 c.compare(c.size() - comment.size(), comment.size(), comment) == 0;
        });
    ASSERT_NE(found, after.end()) << "lost or out of order: " << comment;
    at = static_cast<std::size_t>(found - after.begin());
  }
  EXPECT_NE(patch.text.find("# by the test\n# for a reason\n"), std::string::npos);
  EXPECT_NE(patch.text.find("# was 2.3e10; NiTi backbone"), std::string::npos);
  EXPECT_NE(patch.text.find("effects:\n  - {effect: backlash"), std::string::npos);
  EXPECT_NEAR(patch.robot.body.sections[0].youngs_modulus_Pa, 0.9 * 2.3e10, 1);
  EXPECT_EQ(patch.robot.actuation->tendons[1].motor.torque_scale, 0.95);
  EXPECT_EQ(patch.robot.actuation->tendons[0].motor.torque_scale, 1);
  // Patched again, by other effects: what is there is kept.
  const robot_file::RobotPatch twice =
      robot_file::PatchRobot(patch.text, "rig",
                             {{.name = "torque_constant", .where = "tendon:1", .values = {{"scale", 1.1}}},
                              {.name = "stribeck", .where = "all", .values = {{"torque_Nm", 5e-5}}}},
                             {"again"});
  EXPECT_NEAR(twice.robot.actuation->tendons[0].motor.torque_scale, 1.1, 1e-12);
  EXPECT_EQ(twice.robot.actuation->tendons[1].motor.torque_scale, 0.95);
  EXPECT_EQ(twice.robot.effects.size(), 2u);
}

TEST(Patch, EffectsThatDoNotFitAreRefused) {
  const std::string text = ReadText(kRobots + "rig_90mm.yaml");
  const auto patch = [&](EffectSetting e) { return robot_file::PatchRobot(text, "rig", {std::move(e)}, {}); };
  EXPECT_THROW(patch({.name = "gremlins", .where = "all", .values = {{"scale", 1}}}), std::invalid_argument);
  EXPECT_THROW(patch({.name = "torque_constant", .where = "tendon:9", .values = {{"scale", 1.1}}}),
               std::invalid_argument);
  // Beyond what the patched number may be, by its key.
  EXPECT_THROW(patch({.name = "bending_stiffness", .where = "all", .values = {{"scale", 1e9}}}),
               config::ConfigError);
}

TEST(Patch, DiffShowsWhatChanged) {
  EXPECT_EQ(robot_file::DiffLines("a\nb\nc\nd\ne\n", "a\nb\nX\nd\ne\n"), "  b\n- c\n+ X\n  d\n");
  EXPECT_EQ(robot_file::DiffLines("same\n", "same\n"), "");
}

}  // namespace
}  // namespace tendril::experiment
