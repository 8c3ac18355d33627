// The registry in words: complete, findable by a word, and with commands that can be given as they are.
#include "tendril/gap/explain.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "support/rig_file.h"
#include "tendril/gap/report.h"

namespace tendril::gap {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

using test::Rig;

TEST(Explain, TheTableHasEveryEffectAndEveryCut) {
  const std::string table = EffectsTable();
  for (const sim::Effect& e : sim::Effects()) EXPECT_THAT(table, HasSubstr("  " + std::string(e.name) + " "));
  for (int i = 0; i < sim::kCuts; ++i) {
    const auto cut = static_cast<sim::Cut>(i);
    EXPECT_THAT(table, HasSubstr(std::string(sim::CutName(cut)) + " " + TextOf(cut).title));
  }
}

TEST(Explain, ANameIsFoundInAnySpellingAndAWordInEveryText) {
  EXPECT_EQ(EffectsAbout("Tip payload"), std::vector{sim::FindEffect("tip_payload")});
  EXPECT_EQ(EffectsAbout("TIP-PAYLOAD"), std::vector{sim::FindEffect("tip_payload")});
  EXPECT_THAT(EffectsAbout("quantum"), IsEmpty());
  const auto hits = EffectsAbout("friction");
  ASSERT_GT(hits.size(), 1U);
  EXPECT_THAT(std::string(hits.front()->name), HasSubstr("friction"));  // by name before anything else
  const std::string text = TopicText("friction", hits);
  EXPECT_LT(text.find("by name"), text.find("easily confused"));
}

// What a reader copies is accepted by the robot it is shown for.
TEST(Explain, TheCommandToTryIsAnEffectOfThatRobot) {
  const RobotParameters rig = Rig("rig_60mm");
  for (const sim::Effect& e : sim::Effects()) {
    SCOPED_TRACE(std::string(e.name));
    const std::string text = EffectText(e, &rig), before = "tendril gap simulate --effect \"";
    const auto from = text.find(before) + before.size();
    EXPECT_NO_THROW(sim::ParseEffect(text.substr(from, text.find('"', from) - from), rig));
  }
}

TEST(Explain, BoundsAreThoseOfTheRobot) {
  const sim::Effect& payload = *sim::FindEffect("tip_payload");
  const RobotParameters rig = Rig("rig_60mm");
  const auto of_rig = nlohmann::json::parse(EffectJson(payload, &rig));
  const auto reference = nlohmann::json::parse(EffectJson(payload, nullptr));
  const auto parameters = sim::ParametersOf(payload, {}, rig);
  EXPECT_EQ(of_rig["parameters"][0]["upper"], parameters[0].upper);
  EXPECT_EQ(reference["parameters"][0]["upper"], payload.parameters[0].upper);
  EXPECT_NE(of_rig["parameters"][0]["upper"], reference["parameters"][0]["upper"]);
  EXPECT_FALSE(reference.contains("places"));
  EXPECT_EQ(of_rig["places"], nlohmann::json::array({"all"}));
  EXPECT_THAT(EffectText(payload, &rig), HasSubstr("On " + rig.name + "; in proportion to"));
  EXPECT_THAT(EffectText(payload, nullptr), HasSubstr("For the 90 mm rig"));
}

TEST(Explain, OneIsAnObjectAndSeveralAnArray) {
  const auto all = nlohmann::json::parse(EffectsJson({&sim::Effects()[0], &sim::Effects()[1]}, nullptr));
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[1], nlohmann::json::parse(EffectJson(sim::Effects()[1], nullptr)));
}

}  // namespace
}  // namespace tendril::gap
