// A robot whose numbers are all off within what its file leaves open: no gap without an effect, and an effect
// named beside the numbers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rig_runs.h"
#include "tendril/gap/diagnose.h"

namespace tendril {
namespace {

gap::DataSet RunsWith(const std::string& effect) {
  std::vector<std::string> effects = kNumbersOff;
  if (!effect.empty()) effects.push_back(effect);
  return Recorded(effects, 3, 11, 500);
}

// What looks like them, and what the numbers of the file would look like.
gap::DiagnoseOptions Library() {
  return Only({"tip_payload", "backlash", "routing_friction", "bending_stiffness", "unit_stiffness",
               "capstan_alpha", "tendon_stiffness", "unit_mass"});
}

const gap::LearnedNumber& Learned(const gap::Diagnosis& d, const std::string& key) {
  const auto found = std::find_if(d.learned.begin(), d.learned.end(),
                                  [&](const gap::LearnedNumber& n) { return n.key == key; });
  EXPECT_NE(found, d.learned.end()) << key;
  return *found;
}

TEST(LearnedRobot, WithoutAnEffectThereIsNoGap) {
  const gap::Diagnosis d = Diagnose(RunsWith(""), Library());
  ASSERT_EQ(d.verdict, gap::Verdict::kNoGap) << d.sentence;
  EXPECT_THAT(d.sentence, testing::StartsWith("With the numbers of the robot file fitted to these runs"));
  EXPECT_NEAR(Learned(d, "body.sections.unit_mass_kg").value / Rig().body.sections[0].unit_mass_kg, 0.86,
              0.03);
  EXPECT_TRUE(std::is_sorted(d.learned.begin(), d.learned.end(), [](const auto& a, const auto& b) {
    return std::abs(a.moved) > std::abs(b.moved);
  }));
  EXPECT_LT(std::abs(d.learned.front().moved), 3);
}

TEST(LearnedRobot, AnEffectIsNamedBesideTheNumbers) {
  const gap::Diagnosis d = Diagnose(RunsWith("tip_payload mass_kg=0.003"), Library());
  ASSERT_EQ(d.verdict, gap::Verdict::kAttributed) << d.sentence;
  EXPECT_EQ(d.accepted[0].effect, "tip_payload");
  EXPECT_NEAR(d.accepted[0].parameters.at("mass_kg").value, 0.003, 0.0003);
  EXPECT_FALSE(d.learned.empty());
}

TEST(LearnedRobot, NumbersThatAreKnownStay) {
  gap::DataSet set = RunsWith("");
  KnowEveryNumber(set.robot);
  const gap::Diagnosis d = Diagnose(set, Library());
  EXPECT_EQ(d.verdict, gap::Verdict::kUnexplained) << d.sentence;
  EXPECT_TRUE(d.learned.empty());
}

TEST(LearnedRobot, OfAFileThatExplainsTheRunsNothingIsLearned) {
  const gap::Diagnosis d = Diagnose(Recorded("backlash where=tendon:2 rad=0.3", 3), Library());
  EXPECT_EQ(d.verdict, gap::Verdict::kAttributed) << d.sentence;
  EXPECT_TRUE(d.learned.empty());
}

}  // namespace
}  // namespace tendril
