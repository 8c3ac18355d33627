// `tendril excite --live` against the whole daemon with a simulated robot, LCM between them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <optional>

#include "support/live_daemon.h"
#include "tendril/experiment/experiment_live.h"

namespace tendril::experiment {
namespace {

using test::kLiveUrl;
using test::LiveDaemon;
using testing::HasSubstr;

class LiveTest : public testing::Test {
 protected:
  void SetUp() override {
    daemon_.emplace("rig_90mm.yaml", prefix_);
  }

  LiveOptions Options(bool arm) const {
    return {.lcm_url = kLiveUrl, .channel_prefix = prefix_, .robot = {}, .arm = arm};
  }

  const std::string prefix_ = "EXCITE" + std::to_string(getpid());
  std::optional<LiveDaemon> daemon_;
};

Plan Sway() {
  PlannedRun run = UsualRun("sway");
  run.duration_s = 4;
  return {"live", {run}};
}

TEST_F(LiveTest, ArmsRecordsAndDisarms) {
  std::string remark = "not asked";
  const ExperimentSet set = RunLiveSet(
      Sway(), Options(true), nullptr, [&](const std::string& r) { remark = r; },
      [](std::size_t, double, const Experiment*) {});
  EXPECT_EQ(set.trouble, "");
  EXPECT_EQ(remark, "");
  ASSERT_EQ(set.data.runs.size(), 1u);
  const gap::Run& run = set.data.runs[0];
  EXPECT_EQ(run.family, "sway");
  EXPECT_NEAR(run.time_s.tail(1)[0], 4, 0.5);
  EXPECT_GT(run.tension_N.maxCoeff(), 2) << "it was bent";
  for (Eigen::Index i = 0; i < run.time_s.size() && run.time_s[i] < 0.4; ++i)
    EXPECT_LT(run.motor_position_rad.row(i).cwiseAbs().maxCoeff(), 0.05)
        << "still at first, at the controller's zero";
  // What was armed here is disarmed here: a second operator may not find it running.
  const ExperimentSet refused = RunLiveSet(
      Sway(), Options(false), nullptr, [](const std::string&) {},
      [](std::size_t, double, const Experiment*) {});
  EXPECT_TRUE(refused.data.runs.empty());
  EXPECT_THAT(refused.trouble, HasSubstr("--arm")) << "nothing arms by itself";
}

TEST_F(LiveTest, StopDisarmsAndKeepsTheData) {
  std::atomic<bool> stop = false;
  const ExperimentSet set = RunLiveSet(
      Sway(), Options(true), &stop, [](const std::string&) {},
      [&](std::size_t, double share, const Experiment*) { stop = share > 0.2; });
  EXPECT_THAT(set.trouble, HasSubstr("stopped"));
  ASSERT_EQ(set.data.runs.size(), 1u);
  EXPECT_LT(set.data.runs[0].time_s.tail(1)[0], 3);
  stop = false;
  const ExperimentSet after = RunLiveSet(
      Sway(), Options(false), nullptr, [](const std::string&) {},
      [](std::size_t, double, const Experiment*) {});
  EXPECT_THAT(after.trouble, HasSubstr("configured")) << "released, drives disabled";
}

TEST(Live, WithoutADaemonOneLineSaysSo) {
  try {
    RunLiveSet(
        Sway(), {.lcm_url = "memq://", .channel_prefix = "NOBODY", .robot = {}, .arm = true}, nullptr,
        [](const std::string&) {}, [](std::size_t, double, const Experiment*) {});
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("no daemon answers"));
  }
}

}  // namespace
}  // namespace tendril::experiment
