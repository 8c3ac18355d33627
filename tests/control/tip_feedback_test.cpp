// The tracker's correction: against a tip that stands off by a constant, with lost, old and unordered
// readings.
#include "tendril/control/tip_feedback.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

namespace tendril::control {
namespace {

class TipFeedbackTest : public testing::Test {
 protected:
  static constexpr TimeNs kAhead_ns = 2 * kNsPerMs;
  // Another cycle; a reading of the tip as it was `age` ago, or none.
  Status Step(std::optional<TimeNs> age_ns, const Eigen::Vector3d& off_m) {
    now_ns += kNsPerMs;
    TrackerSample sample;
    if (age_ns) {
      sample.valid = true;
      sample.time_ns = now_ns - *age_ns;
      sample.tip_W_m = WantedAt(sample.time_ns) + off_m + feedback.shift_W_m();
    }
    return feedback.Step(sample, now_ns, kAhead_ns, WantedAt(now_ns + kAhead_ns), Eigen::Vector3d::UnitX(),
                         Eigen::Vector3d::UnitY(), true);
  }
  // A tip that runs fast enough for a wrong time to show.
  static Eigen::Vector3d WantedAt(TimeNs t_ns) { return {0.2 * ToSeconds(t_ns), 0, 0.05}; }

  TipFeedback feedback{
      {.rate_Hz = 100, .position_noise_m = 0, .orientation_noise_rad = 0, .delay_s = 0}, 0.06, 1e-3};
  TimeNs now_ns = kNsPerS;
};

TEST_F(TipFeedbackTest, TakesAwayAConstantErrorSlowlyAndOnlyInThePlane) {
  const Eigen::Vector3d off(1e-3, -2e-3, 3e-3);
  Eigen::Vector3d last(0, 0, 0);
  for (int i = 0; i < 3000; ++i) {
    EXPECT_EQ(Step(i % 10 == 0 ? std::optional(3 * kNsPerMs) : std::nullopt, off), Status::kOk);
    EXPECT_LE((feedback.shift_W_m() - last).norm(), TipFeedback::kMaxRate_mps * 1e-3 + 1e-15);
    last = feedback.shift_W_m();
  }
  EXPECT_NEAR(last.x(), -1e-3, 5e-6);
  EXPECT_NEAR(last.y(), 2e-3, 5e-6);
  EXPECT_EQ(last.z(), 0);
}

TEST_F(TipFeedbackTest, ALostTrackerFreezesTheCorrectionAndSaysSo) {
  for (int i = 0; i < 500; ++i) Step(i % 10 == 0 ? std::optional(0) : std::nullopt, {1e-3, 0, 0});
  Status status = Status::kOk;
  for (int i = 0; i < 20; ++i) Step(std::nullopt, {});
  const Eigen::Vector3d frozen = feedback.shift_W_m();
  for (int i = 0; i < 1000; ++i) status = Step(std::nullopt, {});
  EXPECT_EQ(status, Status::kTrackerLost);
  EXPECT_EQ((feedback.shift_W_m() - frozen).norm(), 0);
  for (int i = 0; i < 20; ++i) status = Step(i % 10 == 0 ? std::optional(0) : std::nullopt, {1e-3, 0, 0});
  EXPECT_EQ(status, Status::kOk);
  EXPECT_NE((feedback.shift_W_m() - frozen).norm(), 0);
}

TEST_F(TipFeedbackTest, OldReadingsAndThoseFromTheFutureDoNotCount) {
  Status status = Status::kOk;
  for (int i = 0; i < 1000; ++i) status = Step(kNsPerS, {1e-3, 0, 0});
  EXPECT_EQ(feedback.shift_W_m().norm(), 0);
  EXPECT_EQ(status, Status::kTrackerLost);
  for (int i = 0; i < 1000; ++i) Step(-5 * kNsPerMs, {1e-3, 0, 0});
  EXPECT_EQ(feedback.shift_W_m().norm(), 0);
}

TEST_F(TipFeedbackTest, WhatATrackerClaimsBeyondAllModelsIsBounded) {
  Status status = Status::kOk;
  for (int i = 0; i < 60000; ++i) status = Step(i % 10 == 0 ? std::optional(0) : std::nullopt, {0.1, 0, 0});
  EXPECT_EQ(status, Status::kLimitedTipCorrection);
  EXPECT_LE(feedback.shift_W_m().norm(), TipFeedback::kMaxShare * 0.06 + 1e-12);
}

}  // namespace
}  // namespace tendril::control
