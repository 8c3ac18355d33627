// `tendril gap simulate`, `diagnose` and `explain` on robots of other sizes than the rig, from 30 mm and a
// gram to 2 m and 5 kg: an effect of plainly visible size can be planted and is named with about its size.
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli.h"
#include "tendril/sim/effects.h"

namespace tendril {
namespace {

using nlohmann::json;
using testing::HasSubstr;

std::string FileOf(const std::string& robot) {
  return TENDRIL_SOURCE_DIR "/tests/support/robots/" + robot + ".yaml";
}

class SizesTest : public CommandTest, public testing::WithParamInterface<const char*> {
 protected:
  /// Plants the effect at a multiple of its plainly visible size for this robot, and diagnoses the runs.
  void Diagnose(const std::string& effect, const std::string& where, const std::string& parameter,
                double times) {
    const RobotParameters robot = sim::LoadRobot(FileOf(GetParam()));
    const sim::Effect& e = *sim::FindEffect(effect);
    for (const sim::EffectParameter& p : sim::ParametersOf(e, sim::ParseTarget(e, where, robot), robot)) {
      if (p.name == parameter) planted_ = times * p.typical;
    }
    WriteText(folder_ / "plan.yaml",
              "runs:\n"
              "  - {family: triangle, duration_s: 5, amplitude_rad: 1.0, repeats: 1}\n"
              "  - {family: circle, duration_s: 5, amplitude_rad: 0.8}\n");
    ASSERT_EQ(Run(fmt::format("gap simulate --robot {} --plan plan.yaml --out runs "
                              "--effect '{} where={} {}={:.6g}'",
                              FileOf(GetParam()), effect, where, parameter, planted_)),
              0)
        << error_;
    ASSERT_EQ(
        Run(fmt::format("gap diagnose --robot {} runs --out found --no-next --only tip_payload,tip_force,"
                        "slack,backbone_hysteresis,encoder_offset,bending_stiffness",
                        FileOf(GetParam()))),
        0)
        << error_;
    const json report = json::parse(ReadText(folder_ / "found/report.json"));
    const json& first = report["causes"][0];
    for (const json& cause : report["causes"]) {
      if (cause["effect"] != effect || cause["where"] != where) continue;
      // Slack and a motor's zero are indistinguishable for a tendon that never becomes slack.
      const bool alike = first["group"] != 0 && cause["group"] == first["group"];
      EXPECT_TRUE(cause == first || alike) << out_;
      EXPECT_GT(cause["p"].get<double>(), alike ? 0.3 : 0.8) << out_;
      EXPECT_NEAR(cause["parameters"][parameter]["value"].get<double>(), planted_, 0.15 * planted_) << out_;
      return;
    }
    FAIL() << out_;
  }

  double planted_ = 0;
};

TEST_P(SizesTest, APayloadIsFound) { Diagnose("tip_payload", "all", "mass_kg", 1); }
TEST_P(SizesTest, AForceIsFound) { Diagnose("tip_force", "all", "x_N", 1); }
TEST_P(SizesTest, SlackIsFound) { Diagnose("slack", "tendon:2", "m", 0.5); }
TEST_P(SizesTest, HysteresisIsFound) { Diagnose("backbone_hysteresis", "all", "moment_Nm", 1); }
TEST_P(SizesTest, AnEncoderOffsetIsFound) { Diagnose("encoder_offset", "tendon:3", "rad", 1); }

TEST_P(SizesTest, ExplainShowsTheBoundsOfTheRobot) {
  ASSERT_EQ(Run("gap explain tip_payload --robot " + FileOf(GetParam())), 0) << error_;
  const RobotParameters robot = sim::LoadRobot(FileOf(GetParam()));
  const auto parameters = sim::ParametersOf(*sim::FindEffect("tip_payload"), {}, robot);
  EXPECT_THAT(out_, HasSubstr(fmt::format("{:.4g}  {:.3g} kg", parameters[0].upper, parameters[0].typical)));
  EXPECT_THAT(out_, HasSubstr(fmt::format("On {}; in proportion to", GetParam())));
}

INSTANTIATE_TEST_SUITE_P(Robots, SizesTest, testing::Values("small_30mm", "large_2m"),
                         [](const auto& of) { return std::string(of.param); });

}  // namespace
}  // namespace tendril
