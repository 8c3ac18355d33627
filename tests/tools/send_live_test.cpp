// What `tendril` says to somebody who asks too early: a daemon that waits for its networks, or whose drives
// do not start. The daemon's messages stand in for it.
#include <atomic>
#include <chrono>
#include <thread>
#include <utility>

#include "../gap/cli.h"
#include "support/live_daemon.h"
#include "tendril/io/gateway.h"

namespace tendril::tools {
namespace {

using test::kLiveUrl;
using testing::HasSubstr;
using testing::Not;
using namespace std::chrono_literals;

class SendLive : public CommandTest {
 protected:
  void TearDown() override {
    stop_ = true;
    if (daemon_.joinable()) daemon_.join();
    CommandTest::TearDown();
  }
  /// Ten times a second until the end of the test.
  template <class Publish>
  void Tell(Publish publish) {
    daemon_ = std::thread([this, publish]() mutable {
      io::Gateway gateway({kLiveUrl, prefix_, 1, 0}, {1, 4, 3}, clock_);
      while (!stop_) {
        publish(gateway);
        gateway.Handle(100);
      }
    });
  }

  const std::string prefix_ = "SEND" + std::to_string(getpid());
  MonotonicClock clock_;
  std::atomic<bool> stop_ = false;
  std::thread daemon_;
};

TEST_F(SendLive, WhatADaemonWaitsForIsToldByEveryProgram) {
  Tell([this](io::Gateway& g) {
    g.PublishEvent(clock_.Now(), Status::kDegraded, "daemon", "waiting: no CAN interface can7");
  });
  const std::string lcm = " --prefix " + prefix_;
  for (const std::string& arguments :
       {"send hold" + lcm, "status" + lcm, "home" + lcm, "follow via --bend 0.1,0 --bend 0,0.1" + lcm,
        "excite --live --set quick" + lcm}) {
    SCOPED_TRACE(arguments);
    EXPECT_EQ(Run(arguments), 1);
    EXPECT_TRUE(OneLine());
    EXPECT_THAT(error_,
                HasSubstr("the daemon does not control anything yet, it is waiting: no CAN interface can7"));
  }
  EXPECT_EQ(Run("send --timeout 2 arm" + lcm), 1);
  EXPECT_THAT(error_, HasSubstr("which is waiting: no CAN interface can7\n"));
  EXPECT_THAT(error_, Not(HasSubstr("_STATE)\n")));
}

TEST_F(SendLive, ArmSaysWhyTheDrivesDoNotStart) {
  CycleRecord record;
  record.output.reported = {Status::kCycleLate, Status::kDriveAbsent};
  record.output.status = Status::kDriveAbsent;
  Tell([record](io::Gateway& g) { g.PublishState(record); });
  EXPECT_EQ(Run("send --timeout 1 --prefix " + prefix_ + " arm"), 1);
  EXPECT_THAT(error_, HasSubstr("waiting for the drives: a drive does not answer"));
  EXPECT_THAT(error_, HasSubstr("the drives did not start within 1 s: a drive does not answer or was not "
                                "started: nothing can be armed (317); see the log; check power and bus"));
  EXPECT_THAT(error_, Not(HasSubstr("cycle finished late")));
}

// As where a machine is too busy to empty the kernel's queue in time.
TEST_F(SendLive, AStopThatWasLostIsSentAgainAndNothingElse) {
  std::atomic<int> heard = 0;
  CycleRecord record;
  record.output.mode = Mode::kRunning;
  Tell([&, listens = false](io::Gateway& g) mutable {
    if (!std::exchange(listens, true)) {
      g.OnCommand([&](const Command& command) {
        if (++heard % 2 == 0) record.input.command = command;
      });
    }
    g.PublishState(record);
  });
  for (const char* stop : {"disarm", "hold"}) {
    SCOPED_TRACE(stop);
    heard = 0;
    EXPECT_EQ(Run("send --timeout 5 --prefix " + prefix_ + " " + stop), 0) << error_;
    EXPECT_GE(heard, 2);
  }
  heard = 0;
  EXPECT_EQ(Run("send --timeout 1 --prefix " + prefix_ + " clear"), 1);
  EXPECT_EQ(heard, 1);
  EXPECT_THAT(error_, HasSubstr("did not receive the command"));
}

}  // namespace
}  // namespace tendril::tools
