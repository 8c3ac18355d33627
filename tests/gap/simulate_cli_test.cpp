// `tendril gap simulate` as a user runs it: the planted effect is in the data and in the truth file, sizes
// are as requested, wrong use is refused before anything is written.
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "cli.h"
#include "tendril/gap/data_set.h"

namespace tendril {
namespace {

using gap::DataSet;
using nlohmann::json;
using testing::HasSubstr;

class SimulateCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    CommandTest::SetUp();
    WriteText(folder_ / "plan.yaml",
              "runs:\n"
              "  - {family: circle, duration_s: 3, repeats: 1}\n"
              "  - {family: triangle, duration_s: 4}\n");
  }
  int Simulate(const std::string& more) {
    return Run(fmt::format("gap simulate --robot {} --plan plan.yaml {}", kRig, more));
  }
  json Truth(const std::string& file = "truth.json") const { return json::parse(ReadText(folder_ / file)); }
  /// Every file of a folder, by name.
  std::map<std::string, std::string> Files(const std::string& name) const {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::directory_iterator(folder_ / name))
      files[entry.path().filename().string()] = ReadText(entry.path());
    return files;
  }
  DataSet Load(const std::string& name) const { return gap::LoadDataSet(folder_ / name, ""); }
};

double Change(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  double square = 0;
  int count = 0;
  for (Eigen::Index i = 0; i < std::min(a.rows(), b.rows()); ++i) {
    for (Eigen::Index j = 0; j < a.cols(); ++j) {
      if (!std::isfinite(a(i, j)) || !std::isfinite(b(i, j))) continue;
      square += (a(i, j) - b(i, j)) * (a(i, j) - b(i, j));
      ++count;
    }
  }
  return std::sqrt(square / count);
}

TEST_F(SimulateCommandTest, PlantedEffectsAreInTruthAndRunsButNotInTheNominalFile) {
  ASSERT_EQ(Simulate("--out plain"), 0) << error_;
  ASSERT_EQ(Simulate("--effect 'tracker_offset x_m=0.002' --effect 'cell_offset where=tendon:2 N=0.2' "
                     "--out planted --truth truth.json"),
            0)
      << error_;
  const json truth = Truth();
  ASSERT_EQ(truth["effects"].size(), 2u);
  EXPECT_EQ(truth["effects"][0],
            (json{{"effect", "tracker_offset"}, {"where", "all"}, {"parameters", {{"x_m", 0.002}}}}));
  EXPECT_EQ(truth["effects"][1],
            (json{{"effect", "cell_offset"}, {"where", "tendon:2"}, {"parameters", {{"N", 0.2}}}}));
  const DataSet plain = Load("plain"), planted = Load("planted");
  ASSERT_EQ(plain.runs.size(), 3u);
  ASSERT_EQ(planted.runs.size(), 3u);
  EXPECT_TRUE(planted.robot.effects.empty());
  EXPECT_EQ(planted.runs[1].repeat_of, planted.runs[0].name);
  // The same noise in both and no feedback from the sensors: only the effect differs.
  EXPECT_NEAR(Change(plain.runs[0].tip_m.col(0), planted.runs[0].tip_m.col(0)), 2e-3, 1e-6);
  EXPECT_LT(Change(plain.runs[0].tip_m.col(1), planted.runs[0].tip_m.col(1)), 1e-6);
  EXPECT_NEAR(Change(plain.runs[0].tension_N.col(1), planted.runs[0].tension_N.col(1)), 0.2, 0.005);
  EXPECT_LT(Change(plain.runs[0].tension_N.col(0), planted.runs[0].tension_N.col(0)), 1e-6);
  // A truth file beside the runs would reveal it to the one who diagnoses them.
  for (const auto& entry : fs::directory_iterator(folder_ / "planted")) {
    EXPECT_EQ(ReadText(entry.path()).find("tracker_offset"), std::string::npos) << entry.path();
  }
}

TEST_F(SimulateCommandTest, TheSameSeedGivesTheSameBytes) {
  ASSERT_EQ(Simulate("--seed 5 --effect 'backlash rad=0.1' --out a"), 0) << error_;
  ASSERT_EQ(Simulate("--seed 5 --effect 'backlash rad=0.1' --out b"), 0) << error_;
  ASSERT_EQ(Simulate("--seed 6 --effect 'backlash rad=0.1' --out c"), 0) << error_;
  for (const char* name : {"01_circle.csv", "02_circle.csv", "03_triangle.csv", "runs.yaml", "robot.yaml"}) {
    EXPECT_EQ(ReadText(folder_ / "a" / name), ReadText(folder_ / "b" / name)) << name;
  }
  EXPECT_NE(ReadText(folder_ / "a/01_circle.csv"), ReadText(folder_ / "c/01_circle.csv"));
}

// The tip moves by this many floors; the floor follows from the tracker's noise and resolution.
TEST_F(SimulateCommandTest, AnEffectBySizeHasThatSize) {
  double previous = 0;
  for (const double sigma : {1.0, 10.0}) {
    ASSERT_EQ(
        Simulate(fmt::format(
            "--effect 'bending_stiffness sigma={}' --out planted --overwrite --truth truth.json", sigma)),
        0)
        << error_;
    const json effect = Truth()["effects"][0];
    EXPECT_NEAR(effect["sigma"]["reached"].get<double>(), sigma, 0.03 * sigma);
    EXPECT_EQ(effect["sigma"]["asked"], sigma);
    EXPECT_THAT(effect["sigma"]["channel"].get<std::string>(), HasSubstr("tip"));
    EXPECT_THAT(out_, HasSubstr("bending_stiffness where=all scale=1.0"));
    // Given tensions bend the robot in proportion to its compliance.
    const double deviation = 1 - 1 / effect["parameters"]["scale"].get<double>();
    EXPECT_GT(deviation, 0);
    if (previous > 0) {
      EXPECT_NEAR(deviation / previous, 10, 1);
    }
    previous = deviation;
  }
  ASSERT_EQ(Simulate("--effect 'bending_stiffness sigma=-3' --out planted --overwrite --truth truth.json"), 0)
      << error_;
  EXPECT_LT(Truth()["effects"][0]["parameters"]["scale"], 1.0);
  // The planted data differ from nominal data of the same noise by about the requested size.
  ASSERT_EQ(Simulate("--effect 'tip_force sigma=10 vary=y_N' --out planted --overwrite --truth truth.json"),
            0)
      << error_;
  ASSERT_EQ(Simulate("--out plain"), 0) << error_;
  const DataSet plain = Load("plain"), planted = Load("planted");
  const double moved = std::sqrt(3.0) * Change(plain.runs[0].tip_m, planted.runs[0].tip_m);
  constexpr double kTrackerNoise_m = 5e-5;
  EXPECT_GT(moved, 5 * kTrackerNoise_m);
  EXPECT_LT(moved, 60 * kTrackerNoise_m);
  EXPECT_EQ(Truth()["effects"][0]["parameters"].size(), 1u);
  EXPECT_GT(Truth()["effects"][0]["parameters"]["y_N"], 0);
}

TEST_F(SimulateCommandTest, AnEffectThatCannotBeSoLargeIsAsLargeAsItsBound) {
  ASSERT_EQ(Simulate("--effect 'gear_efficiency sigma=900' --out planted --truth truth.json"), 0) << error_;
  const json effect = Truth()["effects"][0];
  EXPECT_EQ(effect["parameters"]["scale"], 1.2);
  EXPECT_LT(effect["sigma"]["reached"], 900);
  EXPECT_GT(effect["sigma"]["reached"], 0.5);
  EXPECT_THAT(effect["sigma"]["limited"].get<std::string>(), HasSubstr("bound of scale"));
  EXPECT_THAT(out_, HasSubstr("that is the bound of scale"));
}

TEST_F(SimulateCommandTest, SensorsCanBeLeftOut) {
  ASSERT_EQ(Simulate("--load-cell none --tracker off --out bare"), 0) << error_;
  const DataSet bare = Load("bare");
  EXPECT_EQ(bare.runs[0].tension_N.cols(), 0);
  EXPECT_EQ(bare.runs[0].tip_m.cols(), 0);
  ASSERT_EQ(Simulate("--load-cell robot_side --out other"), 0) << error_;
  EXPECT_EQ(Load("other").runs[0].load_cell, LoadCellPlace::kRobotSide);
}

TEST_F(SimulateCommandTest, WrongUseIsReportedBeforeAnythingIsWritten) {
  const struct {
    const char *arguments, *says;
  } cases[] = {
      {"--effect 'gremlins scale=2'", "there is no effect 'gremlins'"},
      {"--effect 'gremlins sigma=2'", "there is no effect 'gremlins'"},
      {"--effect 'BACKLASH rad=0.1'", "did you mean backlash?"},
      {"--effect 'Bending-Stiffness sigma=2'", "did you mean bending_stiffness?"},
      {"--effect 'backlash where=tendon:4 rad=0.1'", "accepted: all, tendon:1 .. tendon:3"},
      {"--effect 'backlash where=tendon:0 sigma=3'", "accepted: all, tendon:1 .. tendon:3"},
      {"--effect 'unit_stiffness scale=0.9'", "where = 'all'"},
      {"--effect 'backlash mm=0.1'", "backlash has no parameter 'mm'; accepted: rad"},
      {"--effect 'backlash rad=7'", "accepted: 0 .. 1"},
      {"--effect 'backlash rad=nan'", "a finite number"},
      {"--effect 'backlash'", "backlash without rad"},
      {"--effect 'backlash rad=0.1' --effect 'backlash rad=0.2'", "backlash on all twice"},
      {"--effect 'backlash sigma=3' --effect 'backlash sigma=1'", "backlash on all twice"},
      {"--effect ''", "--effect: is empty"},
      {"--effect 'backlash sigma=0'", "sigma = '0'"},
      {"--effect 'backlash sigma=three'", "sigma = 'three'"},
      {"--effect 'backlash sigma=nan'", "sigma = 'nan'"},
      {"--effect 'backlash sigma=1e9'", "a size in floors up to 1000"},
      {"--effect 'backlash sigma=3 sigma=3'", "sigma twice"},
      {"--effect 'backlash sigma=-3'", "positive sizes"},
      {"--effect 'backlash sigma=3 rad=0.1'", "one of them"},
      {"--effect 'backlash sigma=3 vary=mm'", "vary = 'mm'; accepted: rad"},
      {"--effect 'stribeck sigma=3 vary=speed_radps'", "accepted: torque_Nm"},
      {"--effect 'backlash vary=rad rad=0.1'", "vary without sigma"},
      {"--seed -3", "leave out the sign"},
      {"--seed 99999999999999999999", "is not a seed"},
      {"--repeats 21", "--repeats"},
      {"--jobs 0", "--jobs"},
      {"--noise some", "--noise"},
      {"--set quick", "--set"},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(Simulate(fmt::format("{} --out refused --truth refused.json", c.arguments)), 2)
        << c.arguments << error_;
    EXPECT_THAT(error_, HasSubstr(c.says)) << c.arguments;
  }
  EXPECT_EQ(Run("gap simulate --plan plan.yaml --out refused"), 2);
  EXPECT_EQ(
      Run(fmt::format("gap simulate --robot {}/config/robots/qi2021_90mm.yaml --plan plan.yaml --out refused",
                      TENDRIL_SOURCE_DIR)),
      1);
  EXPECT_THAT(error_, HasSubstr("has no actuation"));
  EXPECT_EQ(Run(fmt::format("gap simulate --robot {} --plan gone.yaml --out refused", kRig)), 1);
  EXPECT_THAT(error_, HasSubstr("gone.yaml: cannot be read"));
  EXPECT_EQ(Run(fmt::format("gap simulate --robot {} --daemon gone.yaml --out refused", kRig)), 1);
  EXPECT_THAT(error_, HasSubstr("gone.yaml"));
  // The plan's line, and the place of the truth, before an hour of runs.
  WriteText(folder_ / "far.yaml", "runs:\n  - {family: circle}\n  - {family: circle, amplitude_rad: 12}\n");
  EXPECT_EQ(Run(fmt::format("gap simulate --robot {} --plan far.yaml --out refused", kRig)), 1);
  EXPECT_THAT(error_, HasSubstr("far.yaml:3: circle: amplitude_rad is 12; accepted: above 0 to"));
  EXPECT_TRUE(OneLine());
  for (const char* truth : {"gone/truth.json", "."}) {
    EXPECT_EQ(Simulate(fmt::format("--out refused --truth {}", truth)), 1);
    EXPECT_THAT(error_, HasSubstr(fmt::format("cannot write {}", truth)));
    EXPECT_TRUE(OneLine());
  }
  EXPECT_EQ(Simulate("--out refused --truth plan.yaml"), 2);
  EXPECT_THAT(error_, HasSubstr("would replace plan.yaml"));
  EXPECT_FALSE(fs::exists(folder_ / "refused"));
  EXPECT_FALSE(fs::exists(folder_ / "refused.json"));
}

TEST_F(SimulateCommandTest, AWrongRobotFileIsReportedWithFileAndLine) {
  WriteText(folder_ / "robot.yaml",
            ReadText(kRig) + "\neffects:\n  - {effect: backlash, where: all, rad: 7}\n");
  EXPECT_EQ(Run("gap simulate --robot robot.yaml --plan plan.yaml --out refused"), 1);
  EXPECT_THAT(error_, testing::ContainsRegex("robot.yaml:[0-9]+: effects"));
  EXPECT_TRUE(OneLine());
}

TEST_F(SimulateCommandTest, AnEarlierSetIsReplacedOnlyByACompleteOne) {
  ASSERT_EQ(Simulate("--out set"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("3 runs"));
  WriteText(folder_ / "set/01_mine.csv", "t_s\n0\n");
  WriteText(folder_ / "set/notes.txt", "mine");
  const auto before = Files("set");
  WriteText(folder_ / "far.yaml", "runs: [{family: circle, amplitude_rad: 12}]\n");
  WriteText(folder_ / "bad.yaml", "name: x\n");
  const std::string far = fmt::format("gap simulate --robot {} --plan far.yaml ", kRig);
  EXPECT_EQ(Simulate("--out set"), 2);
  EXPECT_THAT(error_,
              HasSubstr("set already holds a data set (01_circle.csv, 01_mine.csv, 02_circle.csv and 3"));
  EXPECT_THAT(error_, HasSubstr("give another --out, or --overwrite"));
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(Run(far + "--out set --overwrite"), 1);
  EXPECT_EQ(Run("gap simulate --robot bad.yaml --out set --overwrite"), 1);
  EXPECT_EQ(Simulate("--out set --overwrite --daemon gone.yaml"), 1);
  EXPECT_EQ(Simulate("--out set --overwrite --effect 'gremlins a=1'"), 2);
  EXPECT_EQ(Run("gap simulate --robot set/robot.yaml --plan plan.yaml --out set --overwrite"), 2);
  EXPECT_THAT(error_, HasSubstr("would replace set/robot.yaml, which is read here"));
  EXPECT_EQ(Files("set"), before);

  // Only files that the earlier set lists are removed.
  WriteText(folder_ / "plan.yaml", "runs: [{family: circle, duration_s: 3}]\n");
  ASSERT_EQ(Simulate("--out set/ --overwrite"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("1 run,"));
  auto after = Files("set");
  EXPECT_EQ(after["01_mine.csv"], before.at("01_mine.csv"));
  EXPECT_EQ(after["notes.txt"], "mine");
  EXPECT_EQ(Load("set").runs.size(), 1u);
  EXPECT_EQ(after.size(), 5u) << "01_circle.csv, runs.yaml, robot.yaml, and what was not the set's";
}

TEST_F(SimulateCommandTest, OnlyEarlierSetsAreEverReplaced) {
  fs::create_directories(folder_ / "mine");
  WriteText(folder_ / "mine/01_circle.csv", "t_s\n0\n");
  const auto before = Files("mine");
  EXPECT_EQ(Simulate("--out mine"), 2);
  EXPECT_EQ(Simulate("--out mine --overwrite"), 2);
  EXPECT_THAT(error_, HasSubstr("mine/01_circle.csv already exists and is not a run of an earlier set"));
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(Files("mine"), before);
  fs::create_directories(folder_ / "robots");
  WriteText(folder_ / "robots/robot.yaml", ReadText(kRig));
  EXPECT_EQ(Simulate("--out robots"), 2);
  EXPECT_EQ(Simulate("--out robots --overwrite"), 2);
  EXPECT_THAT(error_, HasSubstr("robots/robot.yaml has comments"));
  EXPECT_EQ(ReadText(folder_ / "robots/robot.yaml"), ReadText(kRig));
  EXPECT_EQ(Simulate("--out plan.yaml"), 1);
  EXPECT_THAT(error_, HasSubstr("cannot write into plan.yaml"));
}

// Whenever it is interrupted, the folder holds the earlier set or a consistent one.
TEST_F(SimulateCommandTest, CtrlCLeavesTheEarlierSetOrAConsistentOne) {
  ASSERT_EQ(Simulate("--out set"), 0) << error_;
  const auto before = Files("set");
  WriteText(folder_ / "plan.yaml",
            "runs:\n"
            "  - {family: circle, duration_s: 3}\n"
            "  - {family: hold, duration_s: 600, repeats: 3}\n");
  const auto interrupt = [&](const std::string& more) {
    return std::system(fmt::format("cd {} && timeout -s INT 4 {} gap simulate --robot {} --plan plan.yaml "
                                   "--jobs 1 {} >/dev/null 2>stderr </dev/null",
                                   folder_.string(), TENDRIL_BINARY, kRig, more)
                           .c_str());
  };
  EXPECT_NE(interrupt("--out set --overwrite"), 0);
  EXPECT_EQ(Files("set"), before);
  EXPECT_NE(interrupt("--out fresh"), 0);
  if (fs::exists(folder_ / "fresh/runs.yaml")) {
    const DataSet fresh = Load("fresh");
    EXPECT_TRUE(fresh.notes.empty());
    ASSERT_EQ(fresh.runs.size(), 1u);
    EXPECT_NEAR(fresh.runs[0].time_s.tail(1)[0], 3, 0.1);
    EXPECT_EQ(Files("fresh").size(), 3u);
  }
}

// A load cell without noise is constant while the robot rests; that is no broken cell.
TEST_F(SimulateCommandTest, WithoutNoiseEveryRunReachesItsEnd) {
  WriteText(folder_ / "plan.yaml", "runs: [{family: cocontraction, duration_s: 8}]\n");
  ASSERT_EQ(Simulate("--noise off --load-cell robot_side --effect 'gear_efficiency scale=0.6' --out quiet"),
            0)
      << error_;
  EXPECT_NEAR(Load("quiet").runs[0].time_s.tail(1)[0], 8, 0.1);
}

TEST_F(SimulateCommandTest, TheControllerMayUseAnotherDaemonFile) {
  std::string daemon = ReadText(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
  const std::string robot = "robots/rig_60mm.yaml", friction = "capstan_compensation: true";
  ASSERT_NE(daemon.find(friction), std::string::npos);
  daemon.replace(daemon.find(friction), friction.size(), "capstan_compensation: false");
  daemon.replace(daemon.find(robot), robot.size(), kRig);
  WriteText(folder_ / "frictionless.yaml", daemon);
  ASSERT_EQ(Simulate("--out usual"), 0) << error_;
  ASSERT_EQ(Simulate("--daemon frictionless.yaml --out other"), 0) << error_;
  EXPECT_GT(Change(Load("usual").runs[0].tension_N, Load("other").runs[0].tension_N), 0.05);
}

// A drive reports quantised torque: between two targets the rounding error is larger than once settled, and
// that is no gap due to a delay.
TEST_F(CommandTest, ADelayOfAPartOfACycleIsExplainedToTheNoise) {
  ASSERT_EQ(Run(fmt::format("gap simulate --robot {} --set quick --effect 'command_delay s=0.0004' --out set",
                            kRig)),
            0)
      << error_;
  ASSERT_EQ(Run(fmt::format("gap diagnose --robot {} set --out found --no-next --only "
                            "command_delay,torque_loop_lag,torque_constant,torque_saturation,tip_payload",
                            kRig)),
            0)
      << error_;
  const nlohmann::json report = nlohmann::json::parse(ReadText(folder_ / "found/report.json"));
  const auto& first = report["causes"][0];
  EXPECT_EQ(first["effect"], "command_delay") << out_;
  EXPECT_EQ(first["where"], "all") << out_;
  EXPECT_GT(first["p"].get<double>(), 0.9) << out_;
  EXPECT_NEAR(first["parameters"]["s"]["value"].get<double>(), 0.0004, 2e-5) << out_;
}

}  // namespace
}  // namespace tendril
