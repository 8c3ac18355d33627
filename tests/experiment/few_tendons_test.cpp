// Robots of one tendon and the backbone as its spring, and of an opposed pair, from file to diagnosis. Both
// are made of the 60 mm rig.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "tendril/config/config.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/excitation.h"
#include "tendril/experiment/experiment_run.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnose.h"
#include "tendril/sim/effects.h"

namespace tendril::experiment {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;
const std::vector<double> kOne{0}, kPair{0, kPi}, kPairAcross{kPi / 2, -kPi / 2};

RobotParameters Rig(const std::vector<double>& tendons_rad) {
  RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  robot.name = "few_60mm";
  robot.body.sections[0].tendons.clear();
  for (const double angle : tendons_rad) robot.body.sections[0].tendons.push_back({angle, 0.004});
  robot.actuation->tendons.resize(tendons_rad.size());
  return robot;
}

experiment::ClosedLoopOptions Options(const RobotParameters& robot, ControlLaw law) {
  experiment::ClosedLoopOptions o{.controller_robot = robot,
                                  .plant_robot = robot,
                                  .daemon = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml"),
                                  .plant = {.seed = 1},
                                  .log_path = ""};
  o.daemon.controller.law = law;
  return o;
}

struct Figures {
  double rms_m = 0, largest_m = 0;
  std::map<Status, int> cycles;
};

Figures FollowPlanar(const experiment::ClosedLoopOptions& options) {
  const auto motion = motion::MakeMotion("planar", options.controller_robot);
  experiment::ClosedLoop loop(options);
  loop.ArmAndPretension();
  experiment::ApproachStart(loop, *motion, [](const CycleRecord&, double) {});
  Figures run;
  double sum2 = 0;
  int count = 0;
  experiment::StreamMotion(loop, *motion, [&](const CycleRecord& r, double t_s) {
    ++run.cycles[r.output.status];
    const double error_m = (loop.plant().TipPose().p_WA - motion->TipAt(t_s)).norm();
    run.largest_m = std::max(run.largest_m, error_m);
    sum2 += error_m * error_m;
    ++count;
  });
  loop.DisarmAndWait();
  run.rms_m = std::sqrt(sum2 / count);
  return run;
}

TEST(FewTendons, FollowAPlanarBendUnderBothLaws) {
  for (const auto& tendons : {kOne, kPair, kPairAcross}) {
    for (const ControlLaw law : {ControlLaw::kPaper, ControlLaw::kEquilibrium}) {
      SCOPED_TRACE(testing::Message()
                   << tendons.size() << " from " << tendons[0] << " law " << static_cast<int>(law));
      const Figures run = FollowPlanar(Options(Rig(tendons), law));
      // As the rig of three: its constant-curvature law leaves up to 4 mm, the equilibrium's a fraction of
      // that.
      EXPECT_LT(run.rms_m, law == ControlLaw::kPaper ? 4e-3 : 0.5e-3);
      EXPECT_LT(run.largest_m, law == ControlLaw::kPaper ? 8e-3 : 2e-3);
      for (const auto& [status, cycles] : run.cycles) {
        // Slack: of the tendon at its least tension, as the rig of three shows it.
        EXPECT_TRUE(status == Status::kOk || status == Status::kSlack)
            << StatusText(status) << " in " << cycles << " cycles";
      }
    }
  }
}

TEST(FewTendons, AreToldWhatTheyCannotHold) {
  for (const ControlLaw law : {ControlLaw::kPaper, ControlLaw::kEquilibrium}) {
    const RobotParameters robot = Rig(kPair);
    experiment::ClosedLoop loop(Options(robot, law));
    loop.ArmAndPretension();
    Command command;
    command.kind = CommandKind::kBending;
    command.bending_rad = BendingVector(2);
    command.bending_rad << 0.8, 0.6;
    loop.Send(command);
    int told = 0;
    for (int i = 0; i < 4000; ++i) told += loop.Step().output.status == Status::kLimitedDirection;
    EXPECT_GT(told, 3000);
    EXPECT_NEAR(loop.record().output.target_bending_rad[0], 0.8, 1e-6);
    EXPECT_NEAR(loop.record().output.target_bending_rad[1], 0, 1e-6);
    EXPECT_NEAR(loop.record().output.reference.position_rad[0], 0.8, 1e-6);
    // Out of the plane by more than a tenth of its length: refused, as for any robot.
    command.kind = CommandKind::kTip;
    command.tip_W_m = {0, 0.03, 0.048};
    loop.Send(command);
    loop.Step();
    EXPECT_EQ(loop.Step().output.command_status, Status::kTargetOutOfReach);
    // Tensions lead it as they do any robot.
    command.kind = CommandKind::kTension;
    command.tension_N = TendonVector(2);
    command.tension_N << 0.5, 3;
    loop.Send(command);
    for (int i = 0; i < 4000; ++i) loop.Step();
    EXPECT_NEAR(loop.record().output.tension_desired_base_N[1], 3, 1e-6);
    BendingVector bend(2);
    loop.plant().body().SumBending(loop.plant().q(), bend);
    EXPECT_NEAR(loop.record().output.bending_estimate_rad[0], bend[0], 0.01);
    // The paper's law keeps the direction of its friction while tensions are commanded: the pulleys hold the
    // robot.
    if (law == ControlLaw::kEquilibrium) {
      EXPECT_LT(bend[0], -0.3);
    } else {
      EXPECT_LT(bend[0], 0.8);
    }
    EXPECT_LT(static_cast<int>(loop.record().output.status), 400);
  }
}

// Its zero is the bend that the least tension makes, which estimate and displacement both say.
TEST(FewTendons, OneTendonRestsBentAndKnowsIt) {
  experiment::ClosedLoop loop(Options(Rig(kOne), ControlLaw::kPaper));
  loop.ArmAndPretension();
  for (int i = 0; i < 1000; ++i) loop.Step();
  BendingVector bend(2);
  loop.plant().body().SumBending(loop.plant().q(), bend);
  EXPECT_GT(bend[0], 0.05);
  EXPECT_NEAR(loop.record().output.bending_estimate_rad[0], bend[0], 0.01);
  EXPECT_NEAR(loop.record().output.bending_estimate_rad[1], 0, 1e-3);
}

TEST(FewTendons, AreMovedByEveryExperiment) {
  const ControllerParameters controller =
      experiment::ForExperiments(config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml")).controller;
  for (const auto& tendons : {kOne, kPair, kPairAcross}) {
    const RobotParameters robot = Rig(tendons);
    const Eigen::Vector2d along(std::cos(tendons[0]), std::sin(tendons[0]));
    for (const std::string_view family : experiment::Families()) {
      SCOPED_TRACE(std::string(family) + " of " + std::to_string(tendons.size()));
      const experiment::Program program =
          experiment::MakeProgram(experiment::UsualRun(family), robot, controller);
      const double span =
          (program.targets.colwise().maxCoeff() - program.targets.colwise().minCoeff()).maxCoeff();
      EXPECT_GT(span, program.tension ? 1.0 : 0.5);
      if (program.tension) continue;
      for (Eigen::Index i = 0; i < program.targets.rows(); ++i) {
        const Eigen::Vector2d bend = program.targets.row(i).transpose();
        EXPECT_LT((bend - along * along.dot(bend)).norm(), 1e-9) << "out of the plane that is held";
      }
    }
    experiment::PlannedRun own;
    own.family = "own";
    own.targets = experiment::PlannedRun::Targets::kBending;
    own.waypoints = {{2, {0.3 * along.y(), 0.3 * along.x()}}};
    EXPECT_THAT([&] { experiment::MakeProgram(own, robot, controller); },
                testing::ThrowsMessage<std::invalid_argument>(HasSubstr("cannot be held")));
  }
}

// A set is of as many tendons as its robot file and its tables' names say, whether each was measured or not.
TEST(FewTendons, OfARobotNotMeasuredAreStillItsOwn) {
  const fs::path folder = fs::temp_directory_path() / ("tendril_few_set_" + std::to_string(getpid()));
  const RobotParameters robot = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  const DaemonParameters daemon =
      experiment::ForExperiments(config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml"));
  experiment::PlannedRun run = experiment::UsualRun("hold");
  run.duration_s = 4;
  gap::DataSet set =
      experiment::RunSet(
          {"one", {run}},
          {.controller_robot = robot, .plant_robot = robot, .daemon = daemon, .seed = 1, .threads = 1},
          nullptr, {})
          .data;
  set.runs[0].torque_target_Nm.col(2).setConstant(std::nan(""));
  set.runs[0].torque_actual_Nm.col(2).setConstant(std::nan(""));
  set.runs[0].motor_position_rad.col(2).setConstant(std::nan(""));
  set.runs[0].tension_N.conservativeResize(Eigen::NoChange, 2);
  gap::WriteDataSet(set, folder);
  gap::DataSet read = gap::LoadDataSet(folder, "");
  ASSERT_EQ(read.runs.size(), 1u);
  EXPECT_EQ(read.runs[0].motor_position_rad.cols(), 3);
  EXPECT_EQ(read.runs[0].tension_N.cols(), 3) << "no column of it, but a tendon of the robot";
  // Nothing is known of what pulled tendon 3: that is said, not that there is none.
  try {
    gap::Diagnose(read, {});
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), testing::Not(HasSubstr("runs are of 2 tendons")));
  }
  read.robot = Rig(kPair);
  EXPECT_THAT([&] { gap::Diagnose(read, {}); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("have 3 tendons, robot 'few_60mm' has 2")));
  fs::remove_all(folder);
}

class FewTendonsPrograms : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("tendril_few_test_" + std::to_string(getpid()));
    fs::create_directories(folder_);
    std::ofstream(folder_ / "one.yaml") << config::ToYaml(Rig(kOne));
    std::ofstream(folder_ / "pair.yaml") << config::ToYaml(Rig(kPair));
  }
  void TearDown() override { fs::remove_all(folder_); }

  // Exit code and all that was said.
  std::pair<int, std::string> Run(const std::string& arguments, const std::string& input = "") const {
    const fs::path out = folder_ / "said";
    std::ofstream(folder_ / "input") << input;
    const int status = std::system(
        ("cd " + folder_.string() + " && " TENDRIL_BINARY " " + arguments + " >said 2>&1 <input").c_str());
    std::ifstream in(out);
    std::stringstream text;
    text << in.rdbuf();
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, text.str()};
  }

  fs::path folder_;
};

TEST_F(FewTendonsPrograms, SayWhichDirectionsAreHeld) {
  auto [code, said] = Run("config check one.yaml");
  EXPECT_EQ(code, 0) << said;
  EXPECT_THAT(said, HasSubstr("one tendon bends it only towards 0 deg, the backbone brings it back"));
  std::tie(code, said) = Run("config check pair.yaml");
  EXPECT_EQ(code, 0) << said;
  EXPECT_THAT(said, HasSubstr("two tendons bend it only in the plane through 0 and 180 deg"));
  std::tie(code, said) = Run("demo --no-plots --robot pair.yaml --trajectory circle --out d");
  EXPECT_EQ(code, 1) << said;
  EXPECT_THAT(said,
              HasSubstr("two tendons bend it only in the plane through 0 and 180 deg; accepted: planar"));
  std::tie(code, said) = Run("demo --no-plots --robot one.yaml --out d");
  EXPECT_EQ(code, 0) << said;
  EXPECT_TRUE(fs::exists(folder_ / "d/planar/summary.json"));
  EXPECT_FALSE(fs::exists(folder_ / "d/circle/summary.json"));
}

TEST_F(FewTendonsPrograms, ModelTakesThem) {
  struct Case {
    const char* arguments;
    const char* input;
    int code;
    const char* says;
  };
  for (const Case& c :
       {Case{"model statics --robot one.yaml", "T1\n2\n", 0, "x,y,z"},
        Case{"model statics --robot pair.yaml", "T1,T2\n2,0.5\n", 0, "x,y,z"},
        Case{"model inverse --robot one.yaml", "us1,vs1\n1,0\n", 0, "T1"},
        Case{"model inverse --robot pair.yaml", "us1,vs1\n-1,0\n", 0, "T2"},
        Case{"model inverse --robot pair.yaml --shape equilibrium", "us1,vs1\n-1,0\n", 0, "T2"},
        Case{"model inverse --robot one.yaml --shape equilibrium", "us1,vs1\n1,0\n", 0, "T1"},
        Case{"model inverse --robot pair.yaml", "us1,vs1\n0,1\n", 0, "out of reach"},
        Case{"model inverse --robot one.yaml --shape equilibrium", "us1,vs1\n-1,0\n", 0, "out of reach"},
        Case{"model inverse-tip --robot pair.yaml", "x,y,z\n0.0286479,0,0.0496196\n", 0, "out of reach"},
        Case{"model ik --robot one.yaml", "x,y,z\n0.0286479,0,0.0496196\n", 0, "1.047"}}) {
    const auto [code, said] = Run(c.arguments, c.input);
    EXPECT_EQ(code, c.code) << c.arguments << "\n" << said;
    EXPECT_THAT(said, HasSubstr(c.says)) << c.arguments;
  }
  const auto [code, said] = Run("model accel --robot pair.yaml",
                                "u1,v1,u2,v2,u3,v3,u4,v4,du1,dv1,du2,dv2,du3,dv3,du4,dv4,T1,T2\n"
                                "0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,1,1\n");
  EXPECT_EQ(code, 0) << said;
}

}  // namespace
}  // namespace tendril::experiment
