// What was planted in a simulated set, as people and programs read it.
#include "tendril/experiment/effect_amounts.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace tendril::experiment {
namespace {

SizedEffect Backlash() {
  SizedEffect effect;
  effect.setting = {.name = "backlash", .where = "tendon:2", .values = {{"rad", 0.05}}};
  effect.size.floors = 2.987654;
  effect.size.channel = "tension 2";
  return effect;
}

TEST(EffectAmounts, ALineSaysWhatGivesWhichSizeAndWhatLimitedIt) {
  SizedEffect effect = Backlash();
  EXPECT_EQ(SizeLine(effect), "backlash where=tendon:2 rad=0.05: 2.99 sigma in tension 2");
  effect.limited = "its bound";
  EXPECT_EQ(SizeLine(effect), "backlash where=tendon:2 rad=0.05: 2.99 sigma in tension 2; its bound");
}

// The robot's own effects come first and have no size.
TEST(EffectAmounts, TheTruthHasEveryEffectAndTheSizesOfThoseThatWereRequestedByIt) {
  const EffectSetting own{.name = "tip_payload", .where = "all", .values = {{"mass_kg", 0.002}}};
  const EffectSetting plain{.name = "tendon_stretch", .where = "all", .values = {{"scale", 1.5}}};
  RequestedSize requested;
  requested.sigma = -3;
  const auto json = nlohmann::json::parse(TruthJson("rig.yaml", 7, {own, plain, Backlash().setting},
                                                    {std::nullopt, requested}, {std::nullopt, Backlash()}));
  EXPECT_EQ(json["robot"], "rig.yaml");
  EXPECT_EQ(json["seed"], 7);
  ASSERT_EQ(json["effects"].size(), 3U);
  EXPECT_EQ(json["effects"][0]["parameters"]["mass_kg"], 0.002);
  EXPECT_FALSE(json["effects"][0].contains("sigma"));
  EXPECT_FALSE(json["effects"][1].contains("sigma"));
  EXPECT_EQ(json["effects"][2]["where"], "tendon:2");
  EXPECT_EQ(json["effects"][2]["sigma"]["asked"], 3);
  EXPECT_EQ(json["effects"][2]["sigma"]["reached"], 2.987654);
}

}  // namespace
}  // namespace tendril::experiment
