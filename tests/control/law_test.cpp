// The table of laws, and a law of the test's own: an object with one row, in a controller that knows nothing
// of it.
#include "tendril/control/law.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "ideal_loop.h"
#include "tendril/control/arc_allocation.h"
#include "tendril/control/state_archive.h"

namespace tendril::control {
namespace {

// tendrild.yaml with another law, or why it is refused.
std::string LawOfFile(std::string_view name, ControlLaw* law) {
  std::ifstream file(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
  std::stringstream text;
  text << file.rdbuf();
  std::string yaml = text.str();
  const std::string key = "  law: paper";
  yaml.replace(yaml.find(key), key.size(), "  law: " + std::string(name));
  try {
    *law = config::ParseDaemon(yaml, "tendrild.yaml").controller.law;
    return "";
  } catch (const config::ConfigError& e) {
    return e.what();
  }
}

// The daemon file and the table name the same laws: every row is one of the file, and the file has no other.
TEST(Laws, AreThoseOfTheDaemonFile) {
  std::string names;
  for (std::size_t i = 0; i < Laws().size(); ++i) {
    ControlLaw law{};
    EXPECT_EQ(LawOfFile(Laws()[i].name, &law), "");
    EXPECT_EQ(static_cast<std::size_t>(law), i) << Laws()[i].name;
    names += (i == 0 ? "" : ", ") + std::string(Laws()[i].name);
  }
  ControlLaw law{};
  EXPECT_THAT(LawOfFile("no_law", &law), testing::HasSubstr("accepted: " + names + ";"));
}

// The arcs' tensions with all tendons pulled more and more, up to kMost_N: for its state, which it owns.
class Tightening final : public Law {
 public:
  static constexpr double kStep_N = 0.001, kMost_N = 0.4;

  explicit Tightening(const LawSetup& setup) : limits_(setup.limits), arcs_(setup.body) {}
  void Reset() noexcept override { more_N_ = 0; }
  LawSolution Solve(const LawInput& cycle, CycleOutput& output) noexcept override {
    arcs_.Step(limits_, output);
    if (cycle.joined) more_N_ = std::min(more_N_ + kStep_N, kMost_N);
    output.tension_desired_base_N.array() += more_N_;
    return {.arc_shortening_m = output.displacement_desired_m};
  }
  void Archive(StateArchive& a) noexcept override { a.Value(more_N_); }

 private:
  LimitParameters limits_;
  ArcAllocation arcs_;
  double more_N_ = 0;
};

LawRow Tighten(bool feeds_forward) {
  return {.name = "tightening",
          .feeds_forward = feeds_forward,
          .make = [](const LawSetup& setup) -> std::unique_ptr<Law> {
            return std::make_unique<Tightening>(setup);
          }};
}

const RobotParameters& SharedRig() {
  static const RobotParameters rig = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_60mm.yaml");
  return rig;
}

TEST(Laws, OneOfTheCallersRunsTheRobot) {
  for (const bool feeds_forward : {false, true}) {
    IdealLoop loop(SharedRig(), kParameters, Tighten(feeds_forward));
    loop.RunUntilRunning();
    loop.Run(1000);
    ASSERT_EQ(loop.output.mode, Mode::kRunning);
    // Straight and upright the arcs need no more than the minimum.
    const double most_N = SharedRig().limits.min_tension_N + Tightening::kMost_N;
    EXPECT_NEAR(loop.output.tension_desired_base_N.minCoeff(), most_N, 1e-9);
    EXPECT_NEAR(loop.output.tension_desired_base_N.maxCoeff(), most_N, 1e-9);
    // Armed again it starts from zero.
    loop.Step(loop.ModeCommand(ModeRequest::kDisarm));
    for (int i = 0; i < 2000 && loop.output.mode != Mode::kConfigured; ++i) loop.Step();
    loop.RunUntilRunning();
    EXPECT_LT(loop.output.tension_desired_base_N.maxCoeff(), most_N - 0.5 * Tightening::kMost_N);
  }
}

TEST(Laws, WhatOneRemembersIsInTheControllersState) {
  IdealLoop loop(SharedRig(), kParameters, Tighten(true));
  loop.RunUntilRunning();
  loop.Run(100);
  std::vector<std::byte> state(loop.controller.state_bytes());
  loop.controller.SaveState(state);
  Controller other(loop.robot, kParameters, kNsPerMs, Tighten(true));
  ASSERT_TRUE(other.LoadState(state));
  for (int i = 0; i < 100; ++i) {
    loop.Step();
    CycleOutput again;
    other.Step(loop.input, again);
    ASSERT_EQ(again.tension_desired_base_N, loop.output.tension_desired_base_N) << i;
    ASSERT_EQ(again.torque_desired_Nm, loop.output.torque_desired_Nm) << i;
  }
}

}  // namespace
}  // namespace tendril::control
