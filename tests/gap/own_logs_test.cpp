// Diagnosis of the controller's own LCM logs: the nominal robot shows no gap whichever way it was armed, and
// a payload is named.
#include <fmt/core.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "tendril/config/config.h"
#include "tendril/experiment/closed_loop.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/gap/data_set.h"
#include "tendril/gap/diagnose.h"
#include "tendril/motion/motion.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

namespace fs = std::filesystem;

/// How a log is recorded: `tendril demo`, or with `home` as `tendril home`, `send arm`, `follow`.
struct Case {
  std::string robot, motion;
  ControlLaw law = ControlLaw::kPaper;
  bool home = false;
  std::uint64_t seed = 1;
};

std::string NameOf(const Case& c) {
  return fmt::format("{}_{}_{}{}_{}", c.robot, c.motion,
                     c.law == ControlLaw::kPaper ? "paper" : "equilibrium", c.home ? "_home" : "", c.seed);
}

RobotParameters Robot(const Case& c) {
  return config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/" + c.robot + ".yaml");
}

void Home(experiment::ClosedLoop& loop) {
  const auto reaches = [&](Mode mode, const char* what) {
    loop.StepUntil([mode](const CycleRecord& r) { return r.output.mode == mode; }, 60, what);
  };
  reaches(Mode::kConfigured, "the drives");
  loop.Send(ModeRequest::kHome);
  reaches(Mode::kHold, "homing");
  loop.Send(ModeRequest::kArm);
  reaches(Mode::kRunning, "commands to be followed");
}

void Record(const Case& c, const std::string& effect, const fs::path& log) {
  const RobotParameters nominal = Robot(c);
  RobotParameters plant = nominal;
  if (!effect.empty()) plant.effects.push_back(sim::ParseEffect(effect, plant));
  experiment::ClosedLoopOptions options{
      .controller_robot = nominal,
      .plant_robot = plant,
      .daemon = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml"),
      .plant = {.seed = c.seed},
      .log_path = log.string()};
  options.daemon.controller.law = c.law;
  experiment::ClosedLoop loop(options);
  const auto motion = motion::MakeMotion(c.motion, nominal);
  c.home ? Home(loop) : loop.ArmAndPretension();
  const auto nothing = [](const CycleRecord&, double) {};
  experiment::ApproachStart(loop, *motion, nothing);
  experiment::StreamMotion(loop, *motion, nothing, loop.sender_lead_s());
  loop.DisarmAndWait();
}

gap::Diagnosis Diagnosed(const Case& c, const std::string& effect = "",
                         const std::set<std::string_view>& only = {}) {
  const fs::path folder =
      fs::temp_directory_path() / fmt::format("tendril_own_logs_{}_{}", getpid(), NameOf(c));
  fs::create_directories(folder);
  Record(c, effect, folder / "run.lcmlog");
  gap::DataSet set =
      gap::LoadLogs({folder.string()}, TENDRIL_SOURCE_DIR "/config/robots/" + c.robot + ".yaml");
  fs::remove_all(folder);
  gap::DiagnoseOptions options;
  options.threads = 1;
  options.menu.families.clear();
  for (const sim::Effect& e : sim::Effects()) {
    if (!only.empty() && !only.contains(e.name)) options.without.emplace_back(e.name);
  }
  return gap::Diagnose(set, options);
}

std::string Text(const gap::Diagnosis& d) {
  std::string text = fmt::format("verdict {}", static_cast<int>(d.verdict));
  for (std::size_t i = 0; i < std::min<std::size_t>(3, d.causes.size()); ++i)
    text += fmt::format(", {} {} {:.2f}", d.causes[i].effect, d.causes[i].where, d.causes[i].p);
  for (const auto& cut : d.location) text += fmt::format(", {:.2f}", cut.excess_sigma);
  return text;
}

/// Both rigs, motions and laws, with homing and without: 16, and further seeds.
std::vector<Case> Cases(int count) {
  std::vector<Case> cases;
  for (std::uint64_t seed = 1; std::ssize(cases) < count; ++seed) {
    for (int k = 0; k < 16 && std::ssize(cases) < count; ++k) {
      cases.push_back({(k & 1) != 0 ? "rig_60mm" : "rig_90mm", (k & 2) != 0 ? "circle" : "planar",
                       (k & 4) != 0 ? ControlLaw::kEquilibrium : ControlLaw::kPaper, (k & 8) != 0, seed});
    }
  }
  return cases;
}

class OwnLogs : public testing::TestWithParam<Case> {};

TEST_P(OwnLogs, OfTheNominalRobotShowNoGap) {
  const gap::Diagnosis d = Diagnosed(GetParam());
  EXPECT_EQ(d.verdict, gap::Verdict::kNoGap) << NameOf(GetParam()) << ": " << Text(d);
}

TEST_P(OwnLogs, NameAPayload) {
  const gap::Diagnosis d = Diagnosed(GetParam(), "tip_payload mass_kg=0.002");
  ASSERT_FALSE(d.causes.empty());
  EXPECT_EQ(d.causes.front().effect, "tip_payload") << NameOf(GetParam()) << ": " << Text(d);
  EXPECT_NE(d.sentence.find("tip_payload"), std::string::npos) << d.sentence;
}

// The drives' torques rise from zero when the log begins.
TEST_P(OwnLogs, NameADelay) {
  const gap::Diagnosis d =
      Diagnosed(GetParam(), "command_delay s=0.0016",
                {"command_delay", "torque_loop_lag", "torque_constant", "torque_saturation", "tip_payload"});
  ASSERT_FALSE(d.accepted.empty()) << NameOf(GetParam()) << ": " << Text(d);
  EXPECT_EQ(d.accepted.front().effect, "command_delay") << NameOf(GetParam()) << ": " << Text(d);
  EXPECT_NEAR(d.causes.front().parameters.at("s").value, 0.0016, 5e-5);
}

const auto kName = [](const testing::TestParamInfo<Case>& info) { return NameOf(info.param); };

INSTANTIATE_TEST_SUITE_P(Few, OwnLogs,
                         testing::Values(Case{"rig_90mm", "planar"},
                                         Case{"rig_60mm", "planar", ControlLaw::kEquilibrium, true, 2}),
                         kName);
INSTANTIATE_TEST_SUITE_P(Campaign, OwnLogs, testing::ValuesIn(Cases(40)), kName);

}  // namespace
}  // namespace tendril
