// From an answer to a robot file: no digits that the answer does not know, none lost that it does.
#include "tendril/gap/found_effects.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace tendril::gap {
namespace {

using testing::Contains;
using testing::HasSubstr;

double Found(const Estimate& estimate) {
  Diagnosis d;
  Cause cause;
  cause.effect = "tip_payload";
  cause.where = "all";
  cause.parameters["mass_kg"] = estimate;
  d.accepted.push_back(cause);
  const EffectSetting setting = FoundEffects(d).at(0);
  EXPECT_EQ(setting.name, "tip_payload");
  EXPECT_EQ(setting.where, "all");
  EXPECT_EQ(setting.values.at(0).first, "mass_kg");
  return setting.values.at(0).second;
}

TEST(FoundEffects, DigitsBeyondTheIntervalAreRoundedOff) {
  EXPECT_EQ(Found({.value = 0.00203456789, .low = 0.0019, .high = 0.0021}), 0.002035);
  EXPECT_EQ(Found({.value = 1.23456789, .low = 1.0, .high = 1.5}), 1.23);
}

// A hundredth of the interval at most is rounded off, whatever its place among the decimals.
TEST(FoundEffects, RoundingStaysWellWithinTheInterval) {
  for (const double width : {1e-9, 3e-5, 0.02, 0.7, 5.0, 90.0}) {
    for (const double value : {0.123456789, 1.987654321, -44.4444444}) {
      const Estimate e{.value = value, .low = value - width / 3, .high = value + 2 * width / 3};
      EXPECT_LE(std::abs(Found(e) - value), width / 100 * (1 + 1e-9)) << value << " " << width;
    }
  }
}

TEST(FoundEffects, AValueWithoutAnIntervalStaysAsItIs) {
  EXPECT_EQ(Found({.value = 0.123456789, .low = 0.123456789, .high = 0.123456789}), 0.123456789);
  const double none = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Found({.value = 0.123456789, .low = none, .high = none}), 0.123456789);
}

TEST(FoundEffects, ProvenanceNamesCausesAndLogsInLinesForComments) {
  Diagnosis d;
  d.verdict = Verdict::kAttributed;
  d.robot_name = "rig";
  Cause cause;
  cause.effect = "backlash";
  cause.where = "tendon:2";
  cause.p = 0.987;
  cause.parameters["rad"] = {.value = 0.05, .low = 0.04, .high = 0.06};
  d.accepted.push_back(cause);
  d.closed = Estimate{.value = 0.9, .low = 0.85, .high = 0.93};
  RunSummary run;
  run.name = "night\nrun";
  run.sha256 = "abc";
  d.runs.push_back(run);
  const std::vector<std::string> lines = Provenance(d, "report.json");
  EXPECT_THAT(lines.front(), HasSubstr("report.json"));
  EXPECT_THAT(lines, Contains("backlash tendon:2 (p = 0.987), rad 0.05 [0.04, 0.06]"));
  EXPECT_THAT(lines, Contains("closes 90.0 % [85.0, 93.0] of the gap on held-out runs"));
  EXPECT_THAT(lines, Contains("log night run sha256 abc"));
}

}  // namespace
}  // namespace tendril::gap
