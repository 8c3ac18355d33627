// A verdict on a machine from what was measured of it: each reason alone is enough, and too little is no
// reason.
#include "tendril/rt/fitness.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tendril::rt {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr TimeNs kCycle_ns = kNsPerMs;

/// So many wake-ups, each late by this.
LoopComparison Late(int cycles, TimeNs late_ns) {
  LoopComparison measured;
  for (int i = 0; i < cycles; ++i) measured.loop.Add(late_ns);
  return measured;
}

TEST(Fitness, APunctualLoopOnAGoodMachineIsFit) {
  const Judgement j =
      Judge(kCycle_ns, Late(10'000, 10'000), {{"governor", Verdict::kBetter, "powersave", ""}});
  EXPECT_TRUE(j.fit);
  EXPECT_THAT(j.reasons, IsEmpty());
  EXPECT_EQ(j.limit, "");
}

TEST(Fitness, ABadSettingMissedCyclesAndMissingRightsCount) {
  LoopComparison measured = Late(10'000, 10'000);
  measured.loop_missed = 3;
  measured.problems = "no priority";
  const Judgement j = Judge(kCycle_ns, measured, {{"kernel", Verdict::kBad, "none", "install one"}});
  EXPECT_FALSE(j.fit);
  EXPECT_THAT(j.reasons, ElementsAre(HasSubstr("no priority"), "kernel: none", "3 cycles were missed"));
}

// A twentieth of the cycle for all but one in a thousand, a fifth for the latest.
TEST(Fitness, LatenessIsMeasuredAgainstTheCycle) {
  LoopComparison measured = Late(10'000, 10'000);
  for (int i = 0; i < 20; ++i) measured.loop.Add(100'000);
  EXPECT_THAT(Judge(kCycle_ns, measured, {}).reasons, ElementsAre(HasSubstr("one wake-up in a thousand")));
  EXPECT_TRUE(Judge(4 * kCycle_ns, measured, {}).fit);
  measured = Late(10'000, 10'000);
  measured.loop.Add(250'000);
  EXPECT_THAT(Judge(kCycle_ns, measured, {}).reasons, ElementsAre(HasSubstr("the latest wake-up")));
}

TEST(Fitness, OneInAThousandIsNotJudgedFromAFewCycles) {
  const Judgement j = Judge(kCycle_ns, Late(500, 100'000), {});
  EXPECT_TRUE(j.fit);
  EXPECT_THAT(j.limit, HasSubstr("500 cycles are too few"));
  EXPECT_THAT(j.limit, HasSubstr("--seconds 4 "));
}

}  // namespace
}  // namespace tendril::rt
