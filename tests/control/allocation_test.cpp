// The tick allocates nothing, in any mode.
#include <numbers>
#include <string>
#include <vector>

#include "ideal_loop.h"
#include "support/allocation_count.h"

namespace tendril::control {
namespace {

// Besides the shipped robots one that is pulled one way only, and an opposed pair.
std::vector<RobotParameters> Robots() {
  std::vector<RobotParameters> robots;
  for (const char* file : {"rig_60mm.yaml", "two_section.yaml", "four_tendon_90mm.yaml", "pairs_90mm.yaml"})
    robots.push_back(config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + file));
  for (const std::size_t tendons : {1, 2}) {
    RobotParameters few = robots.front();
    few.name += " of " + std::to_string(tendons);
    few.body.sections[0].tendons.resize(tendons);
    if (tendons == 2) few.body.sections[0].tendons[1].angle_rad = std::numbers::pi;
    few.actuation->tendons.resize(tendons);
    robots.push_back(few);
  }
  return robots;
}

void ExpectNoAllocation(ControlLaw law) {
  for (const RobotParameters& robot : Robots()) {
    ControllerParameters parameters = kParameters;
    parameters.law = law;
    parameters.tension_feedback = law == ControlLaw::kEquilibrium && robot.actuation->pairs.empty();
    IdealLoop loop(robot, parameters);
    const auto count = [&](const char* what) {
      const auto before = test::AllocationCount();
      loop.Run(20);
      EXPECT_EQ(test::AllocationCount(), before) << robot.name << ": " << what;
    };
    ASSERT_GT(test::AllocationCount(), 0u) << "the counter itself works";
    count("disconnected");
    loop.RunUntilRunning();
    count("running");
    loop.Step(loop.Bending(0.3, 0.2));
    count("moving in bending");
    loop.Step(loop.Tip({0.01, 0.002, 0.9 * loop.robot.body.length_m()}));
    count("moving to a tip");
    Command c = loop.Make(CommandKind::kTension);
    c.tension_N = TendonVector::Constant(loop.input.drives, 1.0);
    loop.Step(c);
    count("tensions");
    loop.Step(loop.ModeCommand(ModeRequest::kHold));
    count("hold");
    loop.input.bus_ok = false;
    count("fault");
  }
}

TEST(Controller, AllocatesNothingInAnyMode) { ExpectNoAllocation(ControlLaw::kPaper); }
TEST(Controller, AllocatesNothingInAnyModeWithTheEquilibriumLaw) {
  ExpectNoAllocation(ControlLaw::kEquilibrium);
}

}  // namespace
}  // namespace tendril::control
