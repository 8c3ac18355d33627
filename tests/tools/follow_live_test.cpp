// `tendril follow` as a user runs it, against the whole daemon with a simulated robot.
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "../gap/cli.h"
#include "support/live_daemon.h"
#include "tendril/io/client.h"
#include "tendril_lcm/state_t.hpp"

namespace tendril::tools {
namespace {

using test::kLiveUrl;
using test::LiveDaemon;
using testing::HasSubstr;
using namespace std::chrono_literals;

class FollowLive : public CommandTest {
 protected:
  void SetUp() override {
    CommandTest::SetUp();
    daemon_.emplace("rig_60mm.yaml", prefix_);
    client_.emplace(kLiveUrl, prefix_);
    client_->OnState([this](const tendril_lcm::state_t& s) {
      const std::lock_guard lock(mutex_);
      state_ = s;
      if (s.mode == tendril_lcm::state_t::MODE_RUNNING && watch_) watch_(s);
    });
    listener_ = std::thread([this] {
      while (!stop_) client_->Handle(20);
    });
    ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
    Command arm;
    arm.kind = CommandKind::kMode;
    arm.mode = ModeRequest::kArm;
    arm.sequence = io::NextSequence();
    arm.valid_for_ns = 10 * kNsPerS;
    client_->Send(arm, 0);
    ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_RUNNING));
  }
  void TearDown() override {
    stop_ = true;
    if (listener_.joinable()) listener_.join();
    daemon_.reset();
    CommandTest::TearDown();
  }
  bool Reaches(std::int8_t mode) {
    for (int i = 0; i < 2000; ++i) {
      {
        const std::lock_guard lock(mutex_);
        if (state_.utime != 0 && state_.mode == mode) return true;
      }
      std::this_thread::sleep_for(10ms);
    }
    return false;
  }
  void Watch(std::function<void(const tendril_lcm::state_t&)> watch) {
    const std::lock_guard lock(mutex_);
    watch_ = std::move(watch);
  }
  int Follow(const std::string& what) { return Run("follow --prefix " + prefix_ + " " + what); }

  const std::string prefix_ = "FOLLOW" + std::to_string(getpid());
  std::optional<LiveDaemon> daemon_;
  std::optional<io::Client> client_;
  std::atomic<bool> stop_ = false;
  std::thread listener_;
  std::mutex mutex_;
  tendril_lcm::state_t state_{};
  std::function<void(const tendril_lcm::state_t&)> watch_;
};

TEST_F(FollowLive, PassesItsPointsAheadOfTheSmoothing) {
  double nearest = 1;
  Watch([&](const tendril_lcm::state_t& s) {
    nearest = std::min(nearest, std::hypot(s.bending_desired_rad[0] - 0.4, s.bending_desired_rad[1] - 0.3));
  });
  ASSERT_EQ(Follow("via --bend 0.1,0 --bend 0.4,0.3 --bend -0.2,0.2 --speed 0.8"), 0) << error_;
  Watch(nullptr);
  EXPECT_LT(nearest, 0.02);
  EXPECT_THAT(out_, HasSubstr("followed, sent"));
  EXPECT_THAT(out_, HasSubstr("error of the estimated tip against the motion: rms"));
}

TEST_F(FollowLive, WhatCannotBeFollowedMovesNothing) {
  double moved = 0;
  Watch([&](const tendril_lcm::state_t& s) {
    moved = std::max(moved, std::hypot(s.bending_target_rad[0], s.bending_target_rad[1]));
  });
  WriteText(folder_ / "late.csv", "t_s,us_1,vs_1\n0,0.3,0\n1,0.4,0\n0.5,0.5,0\n");
  EXPECT_EQ(Follow("csv late.csv"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(error_, HasSubstr("late.csv: line 4"));
  EXPECT_EQ(Follow("via --tip 0.02,0,0.055 --tip 0.5,0,0.1"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(Follow("via --bend 0.5,0 --bend 0,0.5 --speed 20"), 2);
  EXPECT_TRUE(OneLine());
  EXPECT_EQ(Follow("circle --robot " TENDRIL_SOURCE_DIR "/config/robots/rig_90mm.yaml"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(error_, HasSubstr("not the daemon's robot"));
  // Another sender's clock is half a minute ahead: that is its own matter, and nothing it asks for moves the
  // robot.
  Command early;
  early.kind = CommandKind::kBending;
  early.bending_rad = BendingVector::Zero(2);
  early.sequence = io::NextSequence() + 3'000'000;
  early.valid_for_ns = kNsPerS;
  client_->Send(early, 0);
  EXPECT_EQ(Follow("csv late.csv"), 1);
  EXPECT_THAT(error_, HasSubstr("late.csv: line 4"));
  EXPECT_EQ(moved, 0);
  EXPECT_EQ(Follow("via --bend 0.1,0 --bend 0,0.1"), 0) << error_;
  EXPECT_GT(moved, 0);
  // Not in mode running: refused, with the mode.
  EXPECT_EQ(Run("send --prefix " + prefix_ + " hold"), 0) << error_;
  EXPECT_EQ(Follow("via --bend 0.5,0 --bend 0,0.5"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(error_, HasSubstr("the daemon is in mode hold: arm it first"));
  EXPECT_EQ(Run("send --prefix " + prefix_ + " arm"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("accepted; mode running"));
  EXPECT_EQ(Run("send --prefix " + prefix_ + " arm"), 0) << error_;
  EXPECT_THAT(out_, HasSubstr("armed already; mode running"));
  Watch(nullptr);
}

// The one that came first is followed to its end; the other ends at once and says whom it met.
TEST_F(FollowLive, OfTwoAtOnceTheSecondIsToldSoAndMovesNothing) {
  std::atomic<bool> told = false;
  double least = 0;
  Watch([&](const tendril_lcm::state_t& s) {
    told = told || s.status == static_cast<int>(Status::kTwoSenders);
    least = std::min(least, s.bending_target_rad[0]);
  });
  int code = -1;
  std::thread first([&] {
    code = std::system(
        fmt::format("{} follow --prefix {} via --bend 0.1,0 --bend 0.5,0.3 --bend 0.2,0 --speed 0.2 "
                    ">{}/first.txt 2>&1",
                    TENDRIL_BINARY, prefix_, folder_.string())
            .c_str());
  });
  for (int i = 0; i < 1000 && ReadText(folder_ / "first.txt").find("0 of") == std::string::npos; ++i)
    std::this_thread::sleep_for(10ms);
  EXPECT_EQ(Follow("via --bend -0.3,0 --bend -0.5,0"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(error_, HasSubstr("the daemon refuses these commands: process "));
  EXPECT_THAT(error_,
              HasSubstr(" controls the robot, and targets of other senders are refused meanwhile; stop one"));
  EXPECT_EQ(Run("send --prefix " + prefix_ + " bending -0.3 0"), 1);
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(error_, HasSubstr("controls the robot"));
  first.join();
  Watch(nullptr);
  EXPECT_EQ(code, 0) << ReadText(folder_ / "first.txt");
  EXPECT_TRUE(told);
  EXPECT_GE(least, 0);
  EXPECT_EQ(Run("send --prefix " + prefix_ + " bending 0 0"), 0) << error_;
}

TEST_F(FollowLive, JoinsSamplesAndEndsWhenTheyExpire) {
  std::atomic<bool> quiet = false;
  double most_rate = 0, furthest = 0;
  Watch([&](const tendril_lcm::state_t& s) {
    most_rate =
        std::max(most_rate, std::hypot(s.bending_rate_desired_radps[0], s.bending_rate_desired_radps[1]));
    furthest = std::max(furthest, s.bending_desired_rad[0]);
  });
  // Ten samples a second of positions alone, for four seconds.
  std::thread sender([&] {
    io::Client samples(kLiveUrl, prefix_ + "S");
    std::this_thread::sleep_for(1500ms);
    for (int i = 0; i < 40 && !quiet; ++i) {
      Command c;
      c.kind = CommandKind::kBending;
      c.bending_rad = BendingVector{{0.2 + 0.15 * std::sin(0.15 * i), 0.1}};
      c.sequence = io::NextSequence();
      c.valid_for_ns = 500 * kNsPerMs;
      samples.Send(c, 0);
      std::this_thread::sleep_for(100ms);
    }
  });
  EXPECT_EQ(Follow("stream --from " + prefix_ + "S --delay 0.15"), 0) << error_;
  quiet = true;
  sender.join();
  Watch(nullptr);
  EXPECT_THAT(out_, HasSubstr("samples followed"));
  EXPECT_GT(furthest, 0.33);
  // The samples move at 0.225 rad/s at most, beside which the daemon closes in at 0.5; a stair of them has
  // steps at the limit of acceleration.
  EXPECT_LT(most_rate, 0.75);
}

TEST_F(FollowLive, ASampleThatIsNoNumberEndsItInOneLine) {
  std::thread sender([&] {
    io::Client samples(kLiveUrl, prefix_ + "S");
    std::this_thread::sleep_for(1500ms);
    for (int i = 0; i < 20; ++i) {
      Command c;
      c.kind = CommandKind::kBending;
      c.bending_rad = BendingVector{{i < 10 ? 0.05 : std::nan(""), 0.0}};
      c.sequence = io::NextSequence();
      c.valid_for_ns = kNsPerS;
      samples.Send(c, 0);
      std::this_thread::sleep_for(100ms);
    }
  });
  EXPECT_EQ(Follow("stream --from " + prefix_ + "S"), 1);
  sender.join();
  EXPECT_TRUE(OneLine());
  EXPECT_THAT(error_, HasSubstr("finite"));
}

}  // namespace
}  // namespace tendril::tools
