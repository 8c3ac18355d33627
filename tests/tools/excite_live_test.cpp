// `tendril excite --live` against the whole daemon in real time, the plant behind drives on a bus in memory,
// LCM between them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <lcm/lcm-cpp.hpp>
#include <optional>
#include <thread>

#include "experiment_live.h"
#include "tendril/can/memory_bus.h"
#include "tendril/config/config.h"
#include "tendril/daemon/daemon.h"
#include "tendril/io/connection.h"
#include "virtual_rig.h"

namespace tendril::tools {
namespace {

using testing::HasSubstr;

/// Drives and plant answer whenever the master looks at the bus.
class LiveBus final : public can::CanPort {
 public:
  explicit LiveBus(const RobotParameters& robot)
      : bus_(clock_), rig_(robot, bus_.AddPort(), {.seed = 3}), port_(bus_.AddPort()) {}
  bool Send(const can::CanFrame& frame) noexcept override { return port_.Send(frame); }
  int Receive(std::span<can::StampedFrame> frames) noexcept override {
    rig_.Poll(clock_.Now());
    return port_.Receive(frames);
  }
  bool WaitUntil(TimeNs deadline_ns) noexcept override {
    rig_.Poll(clock_.Now());
    return port_.WaitUntil(deadline_ns);
  }
  bool up() const noexcept override { return port_.up(); }
  const can::CanCounters& counters() const noexcept override { return port_.counters(); }

 private:
  MonotonicClock clock_;
  can::MemoryBus bus_;
  VirtualRig rig_;
  can::CanPort& port_;
};

double LatestWakeUp() {
  const MonotonicClock clock;
  TimeNs latest_ns = 0;
  for (int i = 0; i < 300; ++i) {
    const TimeNs due_ns = clock.Now() + kNsPerMs;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    latest_ns = std::max(latest_ns, clock.Now() - due_ns);
  }
  return ToSeconds(latest_ns);
}

class LiveTest : public testing::Test {
 protected:
  void SetUp() override {
    try {
      io::OpenLcm(kUrl);
    } catch (const std::runtime_error& e) {
      GTEST_SKIP() << e.what();
    }
    if (const double late_s = LatestWakeUp(); late_s > 0.03) {
      GTEST_SKIP() << "this machine is too busy for real time: it wakes up to " << late_s << " s late";
    }
    robot_ = config::LoadRobot(TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml");
    daemon::DaemonOptions options;
    options.robot = robot_;
    options.parameters = config::LoadDaemon(TENDRIL_SOURCE_DIR "/config/tendrild.yaml");
    auto& p = options.parameters;
    // Generous: the machine may be busy with other tests, and these are not about speed.
    p.realtime = {};
    p.bus.heartbeat_timeout_ms = 5000;
    p.bus.sdo_timeout_ms = 2000;
    p.bus.boot_timeout_ms = 20000;
    p.bus.cycle_ns = 4 * kNsPerMs;
    p.bus.feedback_deadline_ns = 3 * kNsPerMs;
    p.controller.guards.max_missing_cycles = 50;
    p.controller.pretension_ramp_Nps = 50;
    p.lcm.url = kUrl;
    p.lcm.channel_prefix = prefix_;
    bus_.emplace(robot_);
    daemon_.emplace(options, *bus_);
    thread_ = std::thread([this] { daemon_->Run([this] { return stop_.load(); }); });
  }
  void TearDown() override {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }

  LiveOptions Options(bool arm) const {
    return {.lcm_url = kUrl, .channel_prefix = prefix_, .robot = {}, .arm = arm};
  }

  static constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";
  const std::string prefix_ = "EXCITE" + std::to_string(getpid());
  RobotParameters robot_;
  std::optional<LiveBus> bus_;
  std::optional<daemon::Daemon> daemon_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
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
}  // namespace tendril::tools
