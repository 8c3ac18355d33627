// The tracker's correction: against a tip that stands off by a constant, with lost, old and unordered
// readings.
#include "tendril/control/tip_feedback.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <utility>

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
    return Show(sample, WantedAt(now_ns) + feedback.shift_W_m());
  }
  Status Show(const TrackerSample& sample, const Eigen::Vector3d& estimate_W_m) {
    return feedback.Step(sample, now_ns, kAhead_ns, WantedAt(now_ns + kAhead_ns), estimate_W_m,
                         Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(), true);
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
  for (int i = 0; i < 20; ++i) Step(std::nullopt, Eigen::Vector3d::Zero());
  const Eigen::Vector3d frozen = feedback.shift_W_m();
  for (int i = 0; i < 1000; ++i) status = Step(std::nullopt, Eigen::Vector3d::Zero());
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
  for (int i = 0; i < 60000; ++i) status = Step(i % 10 == 0 ? std::optional(0) : std::nullopt, {5e-3, 0, 0});
  EXPECT_EQ(status, Status::kOk) << "a shift of 5 mm takes it away";
  // One that does nothing: the tip stays where it is.
  TrackerSample sample;
  for (int i = 0; i < 60000; ++i) {
    now_ns += kNsPerMs;
    sample.valid = i % 10 == 0;
    sample.time_ns = now_ns;
    sample.tip_W_m = WantedAt(now_ns) + Eigen::Vector3d(5e-3, 0, 0);
    status = Show(sample, WantedAt(now_ns));
  }
  EXPECT_EQ(status, Status::kLimitedTipCorrection);
  EXPECT_LE(feedback.shift_W_m().norm(), TipFeedback::kMaxShare * 0.06 + 1e-12);
}

// The tip moves with the correction, not at once.
TEST_F(TipFeedbackTest, TheCorrectionSetsInEvenly) {
  Eigen::Vector3d last(0, 0, 0), rate(0, 0, 0);
  for (int i = 0; i < 1000; ++i) {
    Step(i % 10 == 0 ? std::optional(3 * kNsPerMs) : std::nullopt, {5e-3, 0, 0});
    const Eigen::Vector3d now = (feedback.shift_W_m() - last) / 1e-3;
    EXPECT_LE((now - rate).norm(), TipFeedback::kMaxAcceleration_mps2 * 1e-3 + 1e-12) << i;
    rate = now;
    last = feedback.shift_W_m();
  }
}

// What cannot be true is no reading: the tendons say where the tip is, to within a tenth of the robot.
TEST_F(TipFeedbackTest, ImplausibleReadingsDoNotCount) {
  const Eigen::Vector3d tip(0.03, 0.01, 0.045);
  const std::pair<const char*, Eigen::Vector3d> shown[] = {
      {"millimetres", 1e3 * tip},
      {"turned round", {-0.03, -0.01, 0.045}},
      {"axes exchanged", {0.01, 0.03, 0.045}},
      {"nothing", {0, 0, 0}},
      {"another marker", {0.05, 0.01, 0.045}},
  };
  for (const auto& [what, reading] : shown) {
    TipFeedback fresh{
        {.rate_Hz = 100, .position_noise_m = 5e-5, .orientation_noise_rad = 0, .delay_s = 0}, 0.06, 1e-3};
    Status status = Status::kOk;
    for (int i = 0; i < 1000; ++i) {
      now_ns += kNsPerMs;
      TrackerSample sample{.valid = i % 10 == 0, .time_ns = now_ns, .tip_W_m = reading};
      sample.tip_W_m.x() += 1e-6 * (i % 7);
      status = fresh.Step(sample, now_ns, kAhead_ns, tip, tip, Eigen::Vector3d::UnitX(),
                          Eigen::Vector3d::UnitY(), true);
    }
    EXPECT_EQ(status, Status::kTrackerLost) << what;
    EXPECT_EQ(fresh.shift_W_m().norm(), 0) << what;
  }
}

// A program that goes on sending what it saw last, with fresh stamps.
TEST_F(TipFeedbackTest, AReadingThatNeverChangesIsNoReading) {
  const Eigen::Vector3d tip(0.03, 0.01, 0.045);
  const auto run = [&](double noise_m) {
    TipFeedback fresh{
        {.rate_Hz = 100, .position_noise_m = noise_m, .orientation_noise_rad = 0, .delay_s = 0}, 0.06, 1e-3};
    Status status = Status::kOk;
    for (int i = 0; i < 2000; ++i) {
      now_ns += kNsPerMs;
      TrackerSample sample{.valid = i % 10 == 0, .time_ns = now_ns, .tip_W_m = tip};
      status = fresh.Step(sample, now_ns, kAhead_ns, tip + Eigen::Vector3d(1e-3, 0, 0), tip,
                          Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(), true);
    }
    EXPECT_LT(fresh.shift_W_m().norm(), noise_m > 0 ? 1e-3 : 1);
    return status;
  };
  EXPECT_EQ(run(5e-5), Status::kTrackerLost);
  EXPECT_EQ(run(0), Status::kTipErrorLeft) << "a tracker without noise may show the same; the tip is stuck";
}

// Dry friction holds the tip a little off; pulling at it until it slips would never end.
TEST_F(TipFeedbackTest, RestsWithinTheNoiseUntilTheTipIsOffAgain) {
  TipFeedback fresh{
      {.rate_Hz = 100, .position_noise_m = 5e-5, .orientation_noise_rad = 0, .delay_s = 0}, 0.06, 1e-3};
  const Eigen::Vector3d tip(0.03, 0.01, 0.045);
  const auto run = [&](double off_m) {
    const Eigen::Vector3d before = fresh.shift_W_m();
    for (int i = 0; i < 2000; ++i) {
      now_ns += kNsPerMs;
      TrackerSample sample{.valid = i % 10 == 0, .time_ns = now_ns, .tip_W_m = tip};
      sample.tip_W_m.x() -= off_m;
      sample.tip_W_m.z() += 1e-6 * (i % 7);
      fresh.Step(sample, now_ns, kAhead_ns, tip, tip, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(),
                 true);
    }
    return (fresh.shift_W_m() - before).norm();
  };
  run(4e-5);
  EXPECT_EQ(run(4e-5), 0);
  EXPECT_EQ(run(1e-4), 0) << "woken at three times the noise only";
  EXPECT_GT(run(3e-4), 1e-4);
}

// A tip that sticks and then leaps too far, as with friction compensated that is not there, would be hunted
// for ever.
TEST_F(TipFeedbackTest, ATipThatLeapsIsNotHuntedForAndItsErrorIsTold) {
  TipFeedback fresh{
      {.rate_Hz = 100, .position_noise_m = 5e-5, .orientation_noise_rad = 0, .delay_s = 0}, 0.06, 1e-3};
  Eigen::Vector3d goal(0.03, 0.01, 0.045), stuck_m(3e-3, 0, 0);
  Status status = Status::kOk;
  int leaps = 0;
  const auto run = [&](int cycles) {
    for (int i = 0; i < cycles; ++i) {
      now_ns += kNsPerMs;
      const Eigen::Vector3d pull_m = fresh.shift_W_m() - stuck_m;
      if (pull_m.norm() > 6e-3) stuck_m += 2 * pull_m, ++leaps;
      TrackerSample sample{.valid = i % 10 == 0, .time_ns = now_ns, .tip_W_m = goal + stuck_m};
      sample.tip_W_m.z() += 1e-6 * (i % 7);
      status = fresh.Step(sample, now_ns, kAhead_ns, goal, goal + stuck_m, Eigen::Vector3d::UnitX(),
                          Eigen::Vector3d::UnitY(), true);
    }
  };
  run(20'000);
  EXPECT_EQ(status, Status::kTipErrorLeft);
  const int by_then = leaps;
  const Eigen::Vector3d left_m = fresh.shift_W_m();
  run(10'000);
  EXPECT_GT(by_then, 0);
  EXPECT_EQ(leaps, by_then);
  EXPECT_EQ(fresh.shift_W_m(), left_m);
  goal.y() += 1e-3;  // another goal is another attempt
  run(1);
  EXPECT_EQ(status, Status::kOk);
}

// It was the bound that stopped the correction, not that nothing came of it: also when it sleeps there.
TEST_F(TipFeedbackTest, ATipHeldFartherOffThanTheBoundIsToldAsThat) {
  TipFeedback fresh{
      {.rate_Hz = 100, .position_noise_m = 5e-5, .orientation_noise_rad = 0, .delay_s = 0}, 0.06, 1e-3};
  const Eigen::Vector3d goal(0.03, 0.01, 0.045), held_m(9e-3, -4e-3, 0);
  Status status = Status::kOk;
  int limited = 0;
  for (int i = 0; i < 60'000; ++i) {
    now_ns += kNsPerMs;
    TrackerSample sample{.valid = i % 10 == 0, .time_ns = now_ns, .tip_W_m = goal + held_m};
    sample.tip_W_m.z() += 1e-6 * (i % 7);
    status = fresh.Step(sample, now_ns, kAhead_ns, goal, goal + held_m, Eigen::Vector3d::UnitX(),
                        Eigen::Vector3d::UnitY(), true);
    EXPECT_NE(status, Status::kTipErrorLeft) << "cycle " << i;
    limited += status == Status::kLimitedTipCorrection;
  }
  EXPECT_EQ(status, Status::kLimitedTipCorrection);
  EXPECT_GT(limited, 40'000);
  EXPECT_NEAR(fresh.shift_W_m().norm(), TipFeedback::kMaxShare * 0.06, 1e-5);
}

}  // namespace
}  // namespace tendril::control
