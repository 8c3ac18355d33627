// Few lines of many findings: none that matters is hidden behind the same one of another run.
#include "tendril/gap/health_lines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tendril::gap {
namespace {

using Severity = HealthFinding::Severity;
using testing::ElementsAre;
using testing::IsEmpty;

HealthFinding Finding(Severity severity, const std::string& run, const std::string& channel,
                      const std::string& text) {
  HealthFinding finding;
  finding.severity = severity;
  finding.run = run;
  finding.channel = channel;
  finding.text = text;
  return finding;
}

const std::vector<HealthFinding> kFindings{
    Finding(Severity::kInfo, "a", "tension 1", "is fine"),
    Finding(Severity::kInfo, "", "file", "one was left out"),
    Finding(Severity::kWarning, "a", "time", "3 rows are missing"),
    Finding(Severity::kError, "a", "tension 1", "constant"),
    Finding(Severity::kWarning, "b", "time", "14 rows are missing"),
    Finding(Severity::kWarning, "c", "time", "stands still"),
    Finding(Severity::kError, "c", "tension 1", "clipped"),
};

TEST(HealthLines, TheWorstComesFirstAndWhatDiffersInNumbersOnlyOnce) {
  EXPECT_THAT(FindingLines(kFindings),
              ElementsAre("wrong data: a: tension 1: constant", "wrong data: c: tension 1: clipped",
                          "data: a: time (and 1 more like it): 3 rows are missing",
                          "data: c: time: stands still", "data: file: one was left out"));
}

TEST(HealthLines, WhatIsLeftOutIsCounted) {
  EXPECT_THAT(FindingLines(kFindings, 1),
              ElementsAre("wrong data: a: tension 1: constant",
                          "data: and 4 more; the report of `tendril gap diagnose` lists all"));
  EXPECT_EQ(FindingLines(kFindings, 5).size(), 5U);
}

TEST(HealthLines, EachChannelsFirstErrorSaysHowManyRunsHaveOne) {
  EXPECT_THAT(ErrorLines(kFindings), ElementsAre("a and 1 more: tension 1 constant"));
  EXPECT_THAT(ErrorLines({}), IsEmpty());
  EXPECT_THAT(FindingLines({}), IsEmpty());
}

}  // namespace
}  // namespace tendril::gap
