// `tendril demo` as a user runs it: what it leaves behind, what its figures must satisfy, and how it fails.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "tendril/config/config.h"
#include "tendril/control/controller.h"
#include "tendril/io/log.h"

namespace tendril {
namespace {

namespace fs = std::filesystem;

struct Outcome {
  int exit_code = -1;
  std::string out, error;
};

std::string ReadFile(const fs::path& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

class DemoTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("tendril_demo_test_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  Outcome Run(const std::string& arguments) const {
    const fs::path out = folder_ / "stdout", error = folder_ / "stderr";
    const std::string command = std::string(TENDRIL_BINARY " ") + arguments + " >" + out.string() + " 2>" +
                                error.string() + " </dev/null";
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, ReadFile(out), ReadFile(error)};
  }

  nlohmann::json Demo(const std::string& trajectory, const std::string& more = "") const {
    const fs::path out = folder_ / ("run_" + trajectory + more);
    const Outcome o =
        Run("demo --no-plots --trajectory " + trajectory + " --out '" + out.string() + "' " + more);
    EXPECT_EQ(o.exit_code, 0) << o.error;
    return nlohmann::json::parse(ReadFile(out / trajectory / "summary.json"));
  }

  fs::path folder_;
};

TEST_F(DemoTest, CircleIsFollowedAndCompensationEarnsItsKeep) {
  const auto on = Demo("circle"), off = Demo("circle", "--compensation off");
  // Two-sided: far better than the constant-curvature law can be is as suspicious as far worse.
  EXPECT_GT(on["tip_rms_error_m"], 0.2e-3);
  EXPECT_LT(on["tip_rms_error_m"], 1.5e-3);
  EXPECT_GT(off["tip_rms_error_m"], 5e-3);
  EXPECT_LT(on["capstan_error_rms_N"].get<double>(), 0.5 * off["capstan_error_rms_N"].get<double>());
  EXPECT_LT(on["base_tension_error_rms_N"].get<double>(),
            0.5 * off["base_tension_error_rms_N"].get<double>());
  for (const auto* run : {&on, &off}) {
    EXPECT_EQ((*run)["deadline_misses"], 0);
    EXPECT_EQ((*run)["feedback_missing"], 0);
    EXPECT_EQ((*run)["commands_refused"], 0);
    EXPECT_GT((*run)["bus_load"], 0.5);
    EXPECT_LE((*run)["bus_load"].get<double>(), (*run)["bus_load_budget"].get<double>());
    ASSERT_EQ((*run)["tensions"].size(), 3u);
  }
  for (const auto& t : on["tensions"]) EXPECT_LT(t["base_error_rms_N"], 0.1);
}

TEST_F(DemoTest, PlanarBendLosesWhatThePaperMeasured) {
  const auto run = Demo("planar");
  EXPECT_GT(run["tip_rms_error_m"], 0.5e-3);
  EXPECT_LT(run["tip_rms_error_m"], 4e-3);
  EXPECT_NEAR(run["friction_loss_max_N"].get<double>(), 1.26, 0.15) << "the paper: 1.26 N at 1.6 rad";
}

TEST_F(DemoTest, LogHoldsTheRunAndReplayGivesTheSameBits) {
  const auto summary = Demo("planar");
  const io::LogContents log = io::ReadLog((folder_ / "run_planar/planar/run.lcmlog").string());
  EXPECT_EQ(log.damage, "");
  EXPECT_EQ(log.cycles.size(), summary["cycles"].get<std::size_t>());
  const RobotParameters robot = config::ParseRobot(log.run.robot_yaml, "robot in the log");
  const DaemonParameters daemon = config::ParseDaemon(log.run.daemon_yaml, "daemon in the log");
  control::Controller controller(robot, daemon.controller, daemon.bus.cycle_ns);
  CycleOutput output;
  for (const CycleRecord& r : log.cycles) {
    controller.Step(r.input, output);
    for (int j = 0; j < robot.body.tendons(); ++j) {
      ASSERT_EQ(output.torque_desired_Nm[j], r.output.torque_desired_Nm[j]) << "cycle " << r.input.cycle;
      ASSERT_EQ(output.torque_target_permille[j], r.output.torque_target_permille[j]);
    }
    ASSERT_EQ(output.tip_estimate_W_m, r.output.tip_estimate_W_m);
    ASSERT_EQ(output.status, r.output.status);
  }
}

TEST_F(DemoTest, SameSeedSameRun) {
  Demo("circle");
  const std::string first = ReadFile(folder_ / "run_circle/circle/samples.csv");
  Demo("circle");
  EXPECT_GT(first.size(), 100000u);
  EXPECT_EQ(first, ReadFile(folder_ / "run_circle/circle/samples.csv"));
  Demo("circle", "--seed 2");
  EXPECT_NE(first, ReadFile(folder_ / "run_circle--seed 2/circle/samples.csv"));
}

TEST_F(DemoTest, OtherRobotsRun) {
  const std::string robots = TENDRIL_SOURCE_DIR "/config/robots/";
  for (const char* file : {"two_section.yaml", "four_tendon_90mm.yaml"}) {
    const auto run = Demo("planar", "--robot " + robots + file);
    EXPECT_EQ(run["cycle_s"], 2e-3) << "more drives than a 1 ms cycle has room for";
    EXPECT_EQ(run["commands_refused"], 0);
  }
}

TEST_F(DemoTest, PlantMayDifferFromWhatTheControllerBelieves) {
  std::string stiff = ReadFile(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml");
  const std::string key = "youngs_modulus_Pa: ";
  const auto at = stiff.find(key);
  ASSERT_NE(at, std::string::npos);
  stiff.replace(at, stiff.find_first_of(" #\n", at + key.size()) - at, key + "2.76e10");
  std::ofstream(folder_ / "stiff.yaml") << stiff;
  const auto nominal = Demo("planar"),
             different = Demo("planar", "--plant " + (folder_ / "stiff.yaml").string());
  EXPECT_GT(different["tip_rms_error_m"].get<double>(), 2 * nominal["tip_rms_error_m"].get<double>());
}

TEST_F(DemoTest, FailuresAreOneLineWithARemedy) {
  struct Case {
    std::string arguments;
    int exit_code;
    std::string says;
  };
  const std::string body_only = TENDRIL_SOURCE_DIR "/config/robots/qi2021_60mm.yaml";
  for (const Case& c :
       {Case{"demo --no-plots --out /proc/nowhere", 1, "--out"},
        Case{"demo --no-plots --robot /no/such.yaml --out " + folder_.string(), 1, "/no/such.yaml"},
        Case{"demo --no-plots --robot " + body_only + " --out " + folder_.string(), 1, "actuation"},
        Case{"demo --trajectory square", 2, "circle"}, Case{"demo --compensation maybe", 2, "on"}}) {
    const Outcome o = Run(c.arguments);
    EXPECT_EQ(o.exit_code, c.exit_code) << c.arguments << "\n" << o.error;
    EXPECT_NE((o.error + o.out).find(c.says), std::string::npos) << c.arguments << "\n" << o.error;
    if (c.exit_code == 1) {
      EXPECT_EQ(std::count(o.error.begin(), o.error.end(), '\n'), 1) << o.error;
    }
  }
}

TEST_F(DemoTest, CtrlCEndsItWithOneLineAndKeepsWhatWasRecorded) {
  const fs::path error = folder_ / "stderr";
  const std::string command = "sh -c '" TENDRIL_BINARY " demo --no-plots --out " + folder_.string() + " 2>" +
                              error.string() + " >/dev/null & until [ -s " +
                              (folder_ / "circle/samples.csv").string() +
                              " ]; do sleep 0.02; done; kill -INT $!; wait $!'";
  const int status = std::system(command.c_str());
  EXPECT_EQ(WEXITSTATUS(status), 1);
  EXPECT_NE(ReadFile(error).find("stopped by Ctrl-C"), std::string::npos) << ReadFile(error);
  EXPECT_GT(fs::file_size(folder_ / "circle/samples.csv"), 0u);
}

}  // namespace
}  // namespace tendril
