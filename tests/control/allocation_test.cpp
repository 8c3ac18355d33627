// The tick allocates nothing, in any mode.
#include "ideal_loop.h"
#include "support/allocation_count.h"

namespace tendril::control {
namespace {

void ExpectNoAllocation(ControlLaw law) {
  for (const char* file : {"rig_60mm.yaml", "two_section.yaml", "four_tendon_90mm.yaml"}) {
    ControllerParameters parameters = kParameters;
    parameters.law = law;
    parameters.tension_feedback = law == ControlLaw::kEquilibrium;
    IdealLoop loop(config::LoadRobot(std::string(TENDRIL_SOURCE_DIR "/config/robots/") + file), parameters);
    const auto count = [&](const char* what) {
      const auto before = test::AllocationCount();
      loop.Run(20);
      EXPECT_EQ(test::AllocationCount(), before) << file << ": " << what;
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
