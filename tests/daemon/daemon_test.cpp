// The whole daemon in real time, with emulated drives on a bus in memory and LCM inside the process.
#include "tendril/daemon/daemon.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/ringbuffer_sink.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <mutex>
#include <set>
#include <thread>

#include "emulated_drives.h"
#include "tendril/control/gate.h"
#include "tendril/daemon/commissioning.h"
#include "tendril/daemon/messages.h"
#include "tendril/io/client.h"
#include "tendril/io/log.h"
#include "tendril/io/wire.h"
#include "tendril_lcm/event_t.hpp"
#include "tendril_lcm/run_t.hpp"
#include "tendril_lcm/state_t.hpp"
#include "tendril_lcm/statistics_t.hpp"

namespace tendril::daemon {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
namespace fs = std::filesystem;

// Generous: the machine may be busy with other tests, and these are not about speed.
DaemonParameters Patient() {
  DaemonParameters p = RigDaemon();
  p.bus.heartbeat_timeout_ms = 5000;
  p.bus.sdo_timeout_ms = 2000;
  p.bus.boot_timeout_ms = 20000;
  p.controller.guards.max_missing_cycles = 50;
  p.controller.guards.max_late_cycles = 5000;
  p.controller.pretension_ramp_Nps = 20;
  return p;
}

// What systemd would be: reads the notifications of this process.
class ServiceManager {
 public:
  ServiceManager() : path_(fs::temp_directory_path() / ("tendril_notify_" + std::to_string(getpid()))) {
    fs::remove(path_);
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path_.native().copy(address.sun_path, sizeof(address.sun_path) - 1);
    EXPECT_EQ(
        bind(socket_, static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof(address)), 0);
    setenv("NOTIFY_SOCKET", path_.c_str(), 1);
    setenv("WATCHDOG_USEC", "300000", 1);
    setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
    reader_ = std::thread([this] {
      std::array<char, 1000> buffer;
      for (ssize_t n; (n = recv(socket_, buffer.data(), buffer.size(), 0)) > 0;) {
        if (std::string_view(buffer.data(), static_cast<std::size_t>(n)) == "WATCHDOG=1") ++fed_;
        received_.emplace(buffer.data(), static_cast<std::size_t>(n));
      }
    });
  }
  ~ServiceManager() {
    if (reader_.joinable()) Received();
    close(socket_);
    fs::remove(path_);
  }
  /// How often the watchdog was fed so far.
  int fed() const { return fed_; }
  /// Everything received; ends the service.
  const std::multiset<std::string>& Received() {
    shutdown(socket_, SHUT_RDWR);
    reader_.join();
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(name);
    return received_;
  }

 private:
  fs::path path_;
  int socket_;
  std::thread reader_;
  std::atomic<int> fed_{0};
  std::multiset<std::string> received_;
};

// What the daemon logs in this test, with its level.
class LogLines {
 public:
  LogLines()
      : sink_(std::make_shared<spdlog::sinks::ringbuffer_sink_mt>(10'000)),
        before_(spdlog::default_logger()) {
    spdlog::set_default_logger(std::make_shared<spdlog::logger>("test", sink_));
  }
  ~LogLines() { spdlog::set_default_logger(before_); }
  LogLines(const LogLines&) = delete;
  LogLines& operator=(const LogLines&) = delete;
  /// Lines of a level, oldest first.
  std::vector<std::string> At(spdlog::level::level_enum level) const {
    std::vector<std::string> lines;
    for (const auto& m : sink_->last_raw()) {
      if (m.level == level) lines.emplace_back(m.payload.data(), m.payload.size());
    }
    return lines;
  }
  std::vector<std::string> Warnings() const { return At(spdlog::level::warn); }

 private:
  std::shared_ptr<spdlog::sinks::ringbuffer_sink_mt> sink_;
  std::shared_ptr<spdlog::logger> before_;
};

struct DaemonTest : testing::Test {
  void Start(const DaemonOptions& o, const std::function<void()>& before = {}) {
    daemon.emplace(o, drives.port());
    client.emplace(daemon->gateway().lcm(), "TENDRIL");
    client->OnState([this](const tendril_lcm::state_t& s) {
      const std::lock_guard lock(mutex);
      state = s;
    });
    client->OnStatistics([this](const tendril_lcm::statistics_t& s) {
      const std::lock_guard lock(mutex);
      statistics.push_back(s);
    });
    client->OnEvent([this](const tendril_lcm::event_t& e) {
      const std::lock_guard lock(mutex);
      texts.push_back(e.source + ": " + e.text);
    });
    if (before) before();
    thread = std::thread([this] {
      daemon->Run([this] {
        while (stands_still) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return stop.load();
      });
    });
  }

  // Seconds from the request to the end of Run.
  double Stop() {
    const auto begin = std::chrono::steady_clock::now();
    stop = true;
    thread.join();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  }

  ~DaemonTest() override {
    stop = true;
    if (thread.joinable()) thread.join();
    fs::remove_all(folder);
  }

  tendril_lcm::state_t State() {
    const std::lock_guard lock(mutex);
    return state;
  }

  template <class Condition>
  bool Within20s(Condition condition) {
    for (int i = 0; i < 2000; ++i) {
      if (condition(State())) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }

  bool Reaches(std::int8_t mode) {
    return Within20s([&](const tendril_lcm::state_t& s) { return s.utime != 0 && s.mode == mode; });
  }

  void Send(Command c) {
    c.sequence = ++sequence;
    c.valid_for_ns = 10 * kNsPerS;
    client->Send(c, 0);
  }
  void Send(ModeRequest request) {
    Command c;
    c.kind = CommandKind::kMode;
    c.mode = request;
    Send(c);
  }

  // Arming takes a record beside this test's own robot file; there is none yet.
  void RequireCommissioning() {
    fs::create_directories(folder);
    options.parameters.commissioning_required = true;
    options.parameters.robot_file = folder / "robot.yaml";
  }

  // Of this test's wiring.
  void Commissioned(const std::vector<CommissionedTendon>& tendons) {
    WriteRecord(RecordPath(options.parameters), {.wiring = WiringHash(options.robot, options.parameters.bus),
                                                 .at = {},
                                                 .by = {},
                                                 .software = {},
                                                 .pull_N = 2,
                                                 .tendons = tendons});
  }

  // What another daemon sends once a second.
  void SendAsAnother() {
    tendril_lcm::run_t run{};
    io::ToMessage({.robot_yaml = "",
                   .daemon_yaml = "",
                   .version = "",
                   .git_revision = "",
                   .start_utime = 1,
                   .daemon = "host elsewhere, process 77, robot other, bus can7"},
                  {}, 1, run);
    daemon->gateway().lcm()->publish("TENDRIL_RUN", &run);
  }

  void Arm() {
    ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
    Send(ModeRequest::kArm);
    ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_RUNNING));
  }

  bool Warns(const std::string& a, const std::string& b = "") {
    return Within20s([&](const auto&) {
      const auto warnings = lines.Warnings();
      return std::any_of(warnings.begin(), warnings.end(), [&](const std::string& line) {
        return line.find(a) != line.npos && line.find(b) != line.npos;
      });
    });
  }

  // Somebody who sends twenty commands a millisecond for as long as this lives.
  class Flood {
   public:
    Flood(DaemonTest& test, const std::function<void(Command&)>& fill)
        : thread_([&test, fill](const std::stop_token& stop) {
            io::Client client(test.daemon->gateway().lcm(), "TENDRIL");
            Command c;
            c.valid_for_ns = kNsPerS;
            fill(c);
            for (c.sequence = 1'000'000; !stop.stop_requested(); ++c.sequence) {
              client.Send(c, 0);
              if (c.sequence % 20 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
            }
          }) {}

   private:
    std::jthread thread_;
  };

  LogLines lines;
  MonotonicClock clock;
  DaemonOptions options{Patient(), RigRobot(), ""};
  EmulatedDrives drives{options.robot, options.parameters, clock};
  std::optional<Daemon> daemon;
  std::optional<io::Client> client;
  std::atomic<bool> stop{false}, stands_still{false};
  std::thread thread;
  std::mutex mutex;
  tendril_lcm::state_t state{};
  std::vector<std::string> texts;
  std::vector<tendril_lcm::statistics_t> statistics;
  std::uint32_t sequence = 0;
  const fs::path folder = fs::temp_directory_path() / ("tendril_daemon_" + std::to_string(getpid()));
};

TEST_F(DaemonTest, FromStartToAnOrderlyEnd) {
  ServiceManager systemd;
  options.log_path = fs::temp_directory_path() / ("tendril_daemon_" + std::to_string(getpid()) + ".lcmlog");
  Start(options);
  Arm();
  Command bend;
  bend.kind = CommandKind::kBending;
  bend.bending_rad = Eigen::Vector2d(0.3, 0);
  Send(bend);
  EXPECT_TRUE(Within20s(
      [](const tendril_lcm::state_t& s) { return std::abs(s.bending_desired_rad[0] - 0.3) < 1e-9; }));
  EXPECT_EQ(State().commands_accepted, 2);

  EXPECT_LT(Stop(), 2.0);
  for (int d = 0; d < 3; ++d) EXPECT_FALSE(drives.rack().enabled(d));
  EXPECT_EQ(State().mode, int{tendril_lcm::state_t::MODE_CONFIGURED}) << "disarmed, not just cut off";

  const std::multiset<std::string>& notifications = systemd.Received();
  EXPECT_EQ(notifications.count("READY=1"), 1U);
  EXPECT_EQ(notifications.count("STOPPING=1"), 1U);
  EXPECT_GE(notifications.count("WATCHDOG=1"), 2U);
  EXPECT_THAT(notifications, Contains(HasSubstr("STATUS=running, ")));

  const io::LogContents log = io::ReadLog(options.log_path);
  EXPECT_EQ(log.damage, "");
  EXPECT_THAT(log.run.robot_yaml, HasSubstr("rig_60mm"));
  ASSERT_GT(log.cycles.size(), 500U);
  for (std::size_t i = 1; i < log.cycles.size(); ++i) {
    ASSERT_EQ(log.cycles[i].input.cycle, log.cycles[i - 1].input.cycle + 1)
        << "a cycle is missing in the log";
  }
  fs::remove(options.log_path);
}

TEST_F(DaemonTest, EndsInTimeEvenWhenTensionsRampDownLonger) {
  options.parameters.controller.pretension_ramp_Nps =
      0.3;  // up to the pretension in a second, down from 1 N in three
  Start(options);
  Arm();
  Command pull;
  pull.kind = CommandKind::kTension;
  pull.tension_N = Eigen::Vector3d(1.0, 1.0, 1.0);
  Send(pull);
  ASSERT_TRUE(Within20s([](const tendril_lcm::state_t& s) { return s.tension_desired_base_N[0] > 0.9; }));
  EXPECT_LT(Stop(), 2.0);
  for (int d = 0; d < 3; ++d) EXPECT_FALSE(drives.rack().enabled(d));
  EXPECT_THAT(texts, testing::Not(Contains(HasSubstr("drives were disabled at once")))) << "led down faster";
  EXPECT_EQ(State().mode, int{tendril_lcm::state_t::MODE_CONFIGURED});
}

// The thread of commands, log and disk stands still (a pipe that nobody reads): it can hear no disarm, so the
// loop disarms by itself; and a signal still ends it.
TEST_F(DaemonTest, StopsByItselfWhenNobodyCouldStopIt) {
  ServiceManager systemd;
  Start(options);
  Arm();
  stands_still = true;
  const int fed = systemd.fed();
  for (int i = 0; i < 500 && drives.rack().enabled(0); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  for (int d = 0; d < 3; ++d) EXPECT_FALSE(drives.rack().enabled(d));
  EXPECT_GE(systemd.fed() - fed, 4) << "in more than a second, with a limit of 0.3 s: it is not cut off";
  stands_still = false;
  EXPECT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  EXPECT_TRUE(Within20s([&](const auto&) {
    const std::lock_guard lock(mutex);
    return std::any_of(texts.begin(), texts.end(),
                       [](const std::string& t) { return t.find("stood still") != t.npos; });
  }));
}

// A log that takes nothing while `blocked`, and then gives it to another.
class BlockedLog final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit BlockedLog(spdlog::sink_ptr next) : next_(std::move(next)) {}
  std::atomic<bool> blocked{false};

 private:
  void sink_it_(const spdlog::details::log_msg& line) override {
    while (blocked) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    next_->log(line);
  }
  void flush_() override {}
  spdlog::sink_ptr next_;
};

// Whoever reads the log has stopped (a pipe that nobody reads): commands are heard and obeyed all the same,
// and what was not to be written is counted once somebody reads on.
TEST_F(DaemonTest, ALogThatTakesNothingMoreHoldsNobodyUp) {
  const auto log = std::make_shared<BlockedLog>(spdlog::default_logger()->sinks().front());
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("blocked", log));
  Start(options);
  Arm();
  log->blocked = true;
  Send(ModeRequest::kHold);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_HOLD));
  for (std::size_t i = 0; i < Messages::kMost + 100; ++i) daemon->Log(Status::kDegraded, "one of many");
  std::this_thread::sleep_for(std::chrono::milliseconds(1300));
  EXPECT_EQ(State().mode, int{tendril_lcm::state_t::MODE_HOLD}) << "not deaf, so it need not disarm";
  Send(ModeRequest::kArm);
  EXPECT_TRUE(Reaches(tendril_lcm::state_t::MODE_RUNNING));
  Send(ModeRequest::kDisarm);
  EXPECT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  EXPECT_LT(Stop(), 2.0);
  {
    const std::lock_guard lock(mutex);
    EXPECT_THAT(texts, testing::Not(Contains(HasSubstr("stood still"))));
  }
  log->blocked = false;
  EXPECT_TRUE(Warns("line(s) were dropped because this log was not read"));
  EXPECT_THAT(lines.At(spdlog::level::info), Contains(HasSubstr("controller: armed -> pretension")));
}

TEST_F(DaemonTest, TheWatchdogIsNotFedWhileTheTickStands) {
  ServiceManager systemd;
  std::atomic<bool> frozen{false};
  drives.bus().SetFilter([&](can::CanFrame&) {
    while (frozen) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return true;
  });
  Start(options);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  frozen = true;
  const int fed = systemd.fed();
  std::this_thread::sleep_for(std::chrono::milliseconds(600));
  EXPECT_LE(systemd.fed() - fed, 1) << "the ticks until then may still have been to tell";
  frozen = false;
  EXPECT_TRUE(Within20s([&](const auto&) { return systemd.fed() > fed + 1; }));
}

TEST_F(DaemonTest, ASignalStopsItWhateverItsOtherThreadDoes) {
  Start(options);
  Arm();
  stands_still = true;
  daemon->RequestStop();
  for (int i = 0; i < 85 && drives.rack().enabled(0); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  for (int d = 0; d < 3; ++d)
    EXPECT_FALSE(drives.rack().enabled(d)) << "before anybody could say it is left alone";
  stands_still = false;
  stop = true;
}

// Far more targets than cycles: a disarm does not wait behind them, and none of it is kept for later.
TEST_F(DaemonTest, ADisarmGoesPastAFloodOfTargets) {
  Start(options);
  Arm();
  Flood flood(*this, [](Command& c) {
    c.kind = CommandKind::kBending;
    c.bending_rad = Eigen::Vector2d(0.1, 0);
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  Send(ModeRequest::kDisarm);
  EXPECT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
}

// The same channel and queue as the disarm's own, which is full of them.
TEST_F(DaemonTest, ADisarmGoesPastAFloodOfHolds) {
  Start(options);
  Arm();
  Flood flood(*this, [](Command& c) {
    c.kind = CommandKind::kMode;
    c.mode = ModeRequest::kHold;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  int asked = 0;
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
    // LCM itself drops what comes too fast.
    if (asked++ % 10 == 0) Send(ModeRequest::kDisarm);
    return s.mode == tendril_lcm::state_t::MODE_CONFIGURED;
  }));
  EXPECT_TRUE(Warns("command(s) arrived faster than one per cycle"));
}

// Nothing in a cycle waits for anybody or fetches a page, from boot to motion, through a fault and its
// clearing.
TEST_F(DaemonTest, StatisticsTellEverySecondAndTheCyclesNeitherWaitNorFetchPages) {
  options.parameters.realtime = {};  // memory locked
  Start(options);
  Arm();
  Command bend;
  bend.kind = CommandKind::kBending;
  bend.bending_rad = Eigen::Vector2d(0.3, 0);
  Send(bend);
  const auto reports = [this] {
    const std::lock_guard lock(mutex);
    return statistics;
  };
  ASSERT_TRUE(Within20s([&](const auto&) { return reports().size() >= 4; }));
  Stop();
  const auto all = reports();
  for (std::size_t i = 2; i < all.size(); ++i) {
    EXPECT_GT(all[i].utime - all[i - 1].utime, 900'000);
    EXPECT_GT(all[i].cycles, all[i - 1].cycles);
  }
  const tendril_lcm::statistics_t& s = all.back();
  for (const auto* counts : {&s.wake_latency_counts, &s.compute_counts, &s.round_trip_counts}) {
    std::int64_t sum = 0;
    for (const std::int64_t count : *counts) sum += count;
    EXPECT_EQ(sum, s.cycles) << "every cycle is in one bin";
  }
  for (const auto& at : {s.wake_latency_ns, s.compute_ns, s.round_trip_ns}) {
    EXPECT_LE(at[0], at[1]);
    EXPECT_LE(at[1], at[2]);
    EXPECT_LE(at[2], at[3]);
  }
  EXPECT_EQ(s.num_drives, 3);
  EXPECT_GT(s.can_sent, s.cycles) << "SYNC and torques";
  EXPECT_GT(s.bus_load, 0.01);
  std::int64_t skipped = 0;
  for (std::size_t i = 0; i < s.miss_cause.size(); ++i) {
    skipped += s.miss_skipped[i];
    EXPECT_NE(s.miss_cause[i], "");
  }
  if (s.num_misses < 16) {
    EXPECT_EQ(skipped, s.deadline_misses);
  }
  EXPECT_EQ(s.voluntary_switches, 0);
  EXPECT_EQ(s.major_faults, 0);
  const bool locked = std::none_of(texts.begin(), texts.end(), [](const std::string& t) {
    return t.find("memory is not locked") != t.npos;
  });
  if (locked) {
    EXPECT_EQ(s.minor_faults, 0);
  }
}

TEST_F(DaemonTest, ARefusedCommandIsAnsweredAndChangesNothing) {
  Start(options);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  Command tip;
  tip.kind = CommandKind::kTip;
  tip.tip_W_m = {0, 0, 0.05};
  Send(tip);
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
    return s.command_sequence == 1 && s.command_status == static_cast<int>(Status::kCommandWrongMode);
  }));
  EXPECT_EQ(State().mode, int{tendril_lcm::state_t::MODE_CONFIGURED});
  EXPECT_EQ(State().command_status_text,
            "command refused in this mode; accepted: arm, home, commission, disarm");
}

// A robot file of a robot that nobody looked at: refused in one line with the remedy, armed as soon as its
// record is there, without a restart.
// What the sender reads is what the log says: where the robot could go instead.
TEST_F(DaemonTest, ATipOutOfReachIsAnsweredWithTheNearestPoint) {
  Start(options);
  Arm();
  Command tip;
  tip.kind = CommandKind::kTip;
  tip.tip_W_m = {0, 0, 0.07};
  Send(tip);
  const std::string why =
      "the requested tip is 10 mm out of reach: the nearest point that the robot can reach is 0 0 0.06 "
      "m; "
      "accepted: up to 6 mm away (a tenth of the robot's length); request a nearer one";
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) { return s.command_status == 211; }));
  EXPECT_EQ(State().command_status_text, why);
  EXPECT_TRUE(Warns("tip 0 0 0.07 m (sequence 2) in mode running: " + why));
  tip.tip_W_m = {0, 0, 60};
  Send(tip);
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
    return s.command_status_text.ends_with("; millimetres? That would be 0 0 0.06 m");
  }));
  tip.tip_W_m = {0, 0, 600};
  Send(tip);
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) { return s.command_status == 202; }));
  EXPECT_EQ(State().command_status_text,
            "the requested tip is 600 m from the base; accepted: up to 100 m; give metres");
  tip.tip_W_m = {0, 0, 0.06};
  Send(tip);
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) { return s.command_status == 0; }));
  EXPECT_EQ(State().command_status_text, "ok");
}

TEST_F(DaemonTest, ArmsOnlyWhatWasCommissioned) {
  RequireCommissioning();
  Start(options);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  for (const ModeRequest request : {ModeRequest::kArm, ModeRequest::kHome}) {
    Send(request);
    EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
      return s.command_sequence == sequence &&
             s.command_status == static_cast<int>(Status::kNotCommissioned) &&
             s.command_status_text.find("tendrild --simulated") != s.command_status_text.npos;
    }));
    EXPECT_EQ(State().mode, int{tendril_lcm::state_t::MODE_CONFIGURED});
  }
  {
    const std::lock_guard lock(mutex);
    EXPECT_THAT(texts, Contains(AllOf(HasSubstr("never commissioned"), HasSubstr("robot.yaml.commissioned"),
                                      HasSubstr("tendril commission"))));
  }
  Commissioned({{.node_id = 1, .tendon = 1}, {.node_id = 2, .tendon = 2}, {.node_id = 3, .tendon = 3}});
  Arm();
}

// Somebody put another drive in: it is configured and works, and is not what was commissioned.
TEST_F(DaemonTest, ArmsOnlyTheDrivesThatWereCommissioned) {
  RequireCommissioning();
  const auto record = [](std::uint32_t second) {
    return std::vector<CommissionedTendon>{{.node_id = 1, .tendon = 1, .serial = kFirstSerial},
                                           {.node_id = 2, .tendon = 2, .serial = second},
                                           {.node_id = 3, .tendon = 3, .serial = kFirstSerial + 2}};
  };
  Commissioned(record(55));
  Start(options);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  EXPECT_TRUE(Warns("daemon: node 2 (tendon 2) has serial 7002, commissioned was 55"))
      << "before anybody asks";
  for (const ModeRequest request : {ModeRequest::kArm, ModeRequest::kHome}) {
    Send(request);
    EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
      return s.command_sequence == sequence && s.command_status == static_cast<int>(Status::kDriveExchanged);
    }));
    EXPECT_EQ(State().mode, int{tendril_lcm::state_t::MODE_CONFIGURED});
  }
  EXPECT_TRUE(Warns("gate: arm or home", "node 2 (tendon 2) has serial 7002, commissioned was 55"));
  // Its commissioning is found without a restart.
  Commissioned(record(kFirstSerial + 1));
  Arm();
}

TEST_F(DaemonTest, ArmsAnExchangedDriveWithAWarningWhereThatIsConfigured) {
  RequireCommissioning();
  options.parameters.exchanged_drives_refused = false;
  Commissioned({{.node_id = 1, .tendon = 1, .serial = kFirstSerial},
                {.node_id = 2, .tendon = 2, .serial = kFirstSerial + 1},
                {.node_id = 3, .tendon = 3, .serial = 56}});
  Start(options);
  Arm();
  EXPECT_TRUE(Warns("node 3 (tendon 3) has serial 7003, commissioned was 56"));
}

// ---- another daemon on the same channels ----

// The first message that another daemon sends is heard before anything is started.
TEST_F(DaemonTest, RefusesToStartBesideAnother) {
  daemon.emplace(options, drives.port());
  EXPECT_NO_THROW(daemon->RefuseOthers(200 * kNsPerMs));
  SendAsAnother();
  try {
    daemon->RefuseOthers(10 * kNsPerS);
    ADD_FAILURE() << "not refused";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), AllOf(HasSubstr("another daemon (host elsewhere, process 77"),
                                HasSubstr("TENDRIL_*"), HasSubstr("lcm.channel_prefix")));
  }
}

TEST_F(DaemonTest, DisarmsWhenAnotherAppearsAndArmsNothingUntilItIsGone) {
  Start(options);
  Arm();
  SendAsAnother();
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED)) << "a safe stop";
  EXPECT_TRUE(Warns("another daemon (host elsewhere, process 77", "disarmed"));
  for (const ModeRequest request : {ModeRequest::kArm, ModeRequest::kHome, ModeRequest::kCommission}) {
    SendAsAnother();
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    Send(request);
    EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
      return s.command_sequence == sequence && s.command_status == static_cast<int>(Status::kNotAlone);
    })) << State().command_status;
    EXPECT_EQ(State().mode, int{tendril_lcm::state_t::MODE_CONFIGURED});
  }
  EXPECT_TRUE(Within20s([&](const auto&) {
    const std::lock_guard lock(mutex);
    return std::any_of(texts.begin(), texts.end(),
                       [](const std::string& t) { return t.find("is silent") != t.npos; });
  }));
  Arm();
}

// What an operator reads names the drive and the object, not only that something is wrong.
TEST_F(DaemonTest, WhyADriveCannotBeUsedIsSaidInTheState) {
  options.robot.actuation->tendons[1].drive.rated_torque_Nm *= 1.5;
  Start(options);
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
    return s.status == 326 && s.status_text.find("(node 2: rated torque: 6076:00 is") != std::string::npos;
  })) << State().status_text;
  EXPECT_FALSE(State().status_remedy.empty());
}

// ---- what is logged, and as what ----

TEST_F(DaemonTest, RefusedCommandsLeaveAWarningEachCauseWithItsCount) {
  Start(options);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  Command tip;
  tip.kind = CommandKind::kTip;
  tip.tip_W_m = {0, 0, 0.05};
  Send(tip);
  EXPECT_TRUE(Warns("tip 0 0 0.05 m (sequence 1) in mode configured: command refused in this mode"));
  Arm();
  Command bend;
  bend.kind = CommandKind::kBending;
  bend.bending_rad = Eigen::Vector2d(9, 0);
  Send(bend);
  EXPECT_TRUE(Warns("bend 9 0 rad", "section 1 would be bent by 9 rad; accepted: up to "));
  Command pull;
  pull.kind = CommandKind::kTension;
  pull.tension_N = Eigen::Vector3d(1, 1, 99);
  Send(pull);
  EXPECT_TRUE(Warns("tension 1 1 99 N", "tendon 3 would have 99 N; accepted: 0 to "));
  pull.tension_N = Eigen::Vector2d(1, 1);
  Send(pull);
  EXPECT_TRUE(Warns("tension 1 1 N", "2 tension(s) given; accepted: 3, one per tendon"));
  Command moving;
  moving.kind = CommandKind::kBending;
  moving.bending_rad = Eigen::Vector2d(0.2, 0);
  moving.bending_rate_radps = Eigen::Vector2d(0.1, 0);
  moving.sequence = ++sequence;
  moving.valid_for_ns = 60 * kNsPerS;
  client->Send(moving, 0);
  EXPECT_TRUE(Warns("bend 0.2 0 rad", "a moving target would be valid for 60 s; accepted: up to 5;"));
  bend.bending_rad[0] = std::nan("");
  Send(bend);
  EXPECT_TRUE(Warns("bend nan 0 rad", "not finite"));
  bend.bending_rad[0] = 0;
  bend.sequence = 1;
  bend.valid_for_ns = kNsPerS;
  client->Send(bend, 0);
  EXPECT_TRUE(Warns("sequence number not newer"));
  bend.sequence = ++sequence;
  for (const TimeNs no_validity : {TimeNs{0}, -kNsPerS, 2 * control::kLongestValid_ns}) {
    bend.sequence = ++sequence;
    bend.valid_for_ns = no_validity;
    client->Send(bend, 0);
    EXPECT_TRUE(Warns(fmt::format("valid_for_s is {:g} or no number; accepted: above 0, up to 3600",
                                  ToSeconds(no_validity))));
  }
}

// A program in the middle of its motion, and another that sends targets as well.
TEST_F(DaemonTest, OfTwoSendersOneLeadsAndStateAndLogTellOfBoth) {
  Start(options);
  Arm();
  const auto bend = [&](std::uint32_t sender, double u_rad) {
    Command c;
    c.kind = CommandKind::kBending;
    c.bending_rad = Eigen::Vector2d(u_rad, 0);
    c.sender = sender;
    c.sequence = ++sequence;
    c.valid_for_ns = 5 * kNsPerS;
    client->Send(c, 0);
    return io::SequenceOf(c);
  };
  for (int i = 0; i < 3; ++i) {
    const std::int64_t sent = bend(4711, 0.1);
    ASSERT_TRUE(Within20s([&](const tendril_lcm::state_t& s) { return s.command_sequence == sent; }));
  }
  const std::int64_t sent = bend(4712, -0.1);
  const std::string why =
      "sender 4711 controls the robot, and targets of other senders are refused meanwhile; stop one of the "
      "two";
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
    return s.command_sequence == sent && s.command_status == static_cast<int>(Status::kAnotherSender) &&
           s.command_status_text == why;
  }));
  EXPECT_TRUE(Within20s([&](const tendril_lcm::state_t& s) {
    return s.cycle % 2 == 0 && s.status == static_cast<int>(Status::kTwoSenders);
  }));
  EXPECT_TRUE(Warns(fmt::format("gate: bend -0.1 0 rad (sequence {} of sender 4712)", sequence), why));
  EXPECT_GT(State().bending_target_rad[0], 0.09);
  // What is told meanwhile is not why the robot stops.
  Command disarm;
  disarm.kind = CommandKind::kMode;
  disarm.mode = ModeRequest::kDisarm;
  disarm.sequence = ++sequence;
  client->Send(disarm, 0);
  EXPECT_TRUE(Within20s([](const tendril_lcm::state_t& s) {
    return s.mode == tendril_lcm::state_t::MODE_CONFIGURED &&
           s.status == static_cast<int>(Status::kTwoSenders);
  }));
  EXPECT_THAT(lines.At(spdlog::level::info), Contains("controller: running -> safe stop: 0 ok"));
}

TEST_F(DaemonTest, ACommandWithoutValuesIsLoggedAsSuch) {
  Start(options);
  Arm();
  Command bend;
  bend.kind = CommandKind::kBending;
  Send(bend);
  EXPECT_TRUE(Warns("bend without any value (sequence 2)",
                    "0 bend value(s) given; accepted: 2, u and v of each section"));
}

// While the daemon makes sure that it is alone nobody takes readings or targets: that says nothing of their
// rate.
TEST_F(DaemonTest, WhatCameBeforeTheLoopRanWasNotTooFast) {
  Start(options, [this] {
    auto* lcm = daemon->gateway().lcm();
    tendril_lcm::tracker_t reading{};
    Command bend;
    bend.kind = CommandKind::kBending;
    bend.bending_rad = Eigen::Vector2d(0.1, 0);
    for (int i = 0; i < 30; ++i) {
      for (int k = 0; k < 10; ++k) {
        lcm->publish("TENDRIL_TRACKER", &reading);
        Send(bend);
      }
      daemon->RefuseOthers(kNsPerMs);
    }
  });
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  ASSERT_TRUE(Within20s([&](const auto&) {
    const std::lock_guard lock(mutex);
    return statistics.size() >= 3;
  }));
  EXPECT_THAT(lines.Warnings(), testing::Each(testing::Not(HasSubstr("were dropped"))));
}

// A sender gone mad: a line a second, and every one of its commands is counted.
TEST_F(DaemonTest, AFloodOfRefusedCommandsIsALineASecond) {
  Start(options);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  constexpr int kSent = 200;
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < kSent; ++i) {
    Send(ModeRequest::kHold);  // no other command overtakes it
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_TRUE(Warns("refused for this, 200 since start"));
  const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  int told = 0;
  for (const std::string& line : lines.Warnings()) told += line.find("hold (sequence") != line.npos;
  EXPECT_LE(told, took_s + 2);
}

TEST_F(DaemonTest, MessagesThatNobodyUnderstandsLeaveAWarningAndAreCounted) {
  Start(options);
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_CONFIGURED));
  daemon->gateway().lcm()->publish("TENDRIL_COMMAND_TIP", "rubbish", 7);
  EXPECT_TRUE(Warns("gateway: TENDRIL_COMMAND_TIP: message ignored", "1 ignored since start"));
  EXPECT_TRUE(Within20s([&](const auto&) {
    const std::lock_guard lock(mutex);
    return !statistics.empty() && statistics.back().messages_ignored == 1;
  }));
}

TEST_F(DaemonTest, FaultsAreErrorsLossesAreWarningsAndTheRestIsInformation) {
  options.parameters.black_box = {.seconds = 1, .folder = "/proc/tendril_none"};
  std::atomic<bool> silent{false};
  drives.bus().SetFilter([&](can::CanFrame& f) { return !(silent.load() && f.id == 0x182); });
  Start(options);
  Arm();
  silent = true;
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_FAULT));
  EXPECT_TRUE(Warns("black box: the cycles before fault 406", "/proc/tendril_none"));
  EXPECT_THAT(lines.Warnings(), Contains(AllOf(HasSubstr("faults will leave no black box"),
                                               HasSubstr("/proc/tendril_none"), HasSubstr("--black-box"))));
  EXPECT_THAT(lines.At(spdlog::level::err), Contains(HasSubstr("controller: running -> fault: 406")));
  EXPECT_THAT(lines.At(spdlog::level::info), Contains(HasSubstr("controller: armed -> pretension")));
  EXPECT_THAT(lines.Warnings(), Contains(HasSubstr("commissioning is not required")));
  // The same for whoever looks at the daemon later.
  EXPECT_TRUE(Within20s([&](const auto&) {
    const std::lock_guard lock(mutex);
    return !statistics.empty() && statistics.back().last_fault_status == 406;
  }));
  const std::lock_guard lock(mutex);
  const tendril_lcm::statistics_t& s = statistics.back();
  EXPECT_THAT(s.last_fault_text, HasSubstr("(tendon 2, node 2)"));
  EXPECT_GT(s.last_fault_utime, s.utime - 20'000'000);
  EXPECT_LE(s.last_fault_utime, s.utime);
  EXPECT_THAT(s.drive_node_id, testing::ElementsAre(1, 2, 3));
  EXPECT_THAT(s.drive_serial, testing::ElementsAre(kFirstSerial, kFirstSerial + 1, kFirstSerial + 2));
  EXPECT_THAT(s.drive_error_code, testing::ElementsAre(0, 0, 0));
  EXPECT_EQ(s.publish_failed, 0);
}

// The drives' answers stop; what was before lies in the folder, whole and ending with the fault.
TEST_F(DaemonTest, AFaultLeavesTheCyclesBeforeIt) {
  options.parameters.black_box = {.seconds = 1, .folder = (folder / "new").string()};
  std::atomic<bool> silent{false};
  drives.bus().SetFilter([&](can::CanFrame& f) { return !(silent.load() && f.id == 0x182); });
  Start(options);
  Arm();
  ASSERT_TRUE(Within20s([](const tendril_lcm::state_t& s) { return s.cycle > 1500; }));
  silent = true;
  ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_FAULT));
  const auto told = [this] {
    const std::lock_guard lock(mutex);
    for (const std::string& t : texts) {
      if (t.starts_with("black box: ")) return t;
    }
    return std::string();
  };
  ASSERT_TRUE(Within20s([&](const auto&) { return !told().empty(); }));
  Stop();

  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder / "new")) files.push_back(entry.path());
  ASSERT_EQ(files.size(), 1U);
  EXPECT_THAT(files[0].filename().string(),
              testing::MatchesRegex("20[0-9]{6}T[0-9]{6}\\.[0-9]{3}Z_406_FeedbackStale\\.lcmlog"));
  EXPECT_THAT(told(), AllOf(HasSubstr("406 FeedbackStale"), HasSubstr(files[0].string())));

  std::vector<std::uint64_t> cycles;
  io::StateSnapshot snapshot;
  io::RunInfo run;
  CycleRecord last;
  const std::string damage = io::StreamLog(
      files[0].string(), [&](const io::RunInfo& r) { run = r; },
      [&](const CycleRecord& r, std::uint64_t) {
        cycles.push_back(r.input.cycle);
        last = r;
      },
      [&](const io::StateSnapshot& s) { snapshot = s; });
  EXPECT_EQ(damage, "");
  EXPECT_THAT(run.daemon_yaml, HasSubstr("black_box"));
  ASSERT_GE(cycles.size(), 1000U) << "at least as long as asked for";
  EXPECT_LE(cycles.size(), 1100U);
  EXPECT_EQ(snapshot.next_cycle, cycles.front());
  EXPECT_EQ(cycles.back() - cycles.front() + 1, cycles.size()) << "no cycle is missing";
  EXPECT_EQ(last.output.mode, Mode::kFault) << "the cycle of the fault is the last";
  EXPECT_EQ(last.output.status, Status::kFeedbackStale);
}

TEST_F(DaemonTest, ABlackBoxThatCannotBeWrittenIsReportedAndTheDaemonGoesOn) {
  options.parameters.black_box = {.seconds = 1, .folder = "/proc/tendril_none"};
  std::atomic<bool> silent{false};
  drives.bus().SetFilter([&](can::CanFrame& f) { return !(silent.load() && f.id == 0x182); });
  Start(options);
  Arm();
  for (int faults = 1; faults <= 2; ++faults) {
    silent = true;
    ASSERT_TRUE(Reaches(tendril_lcm::state_t::MODE_FAULT));
    silent = false;
    ASSERT_TRUE(Within20s([&](const auto&) {
      const std::lock_guard lock(mutex);
      return std::count_if(texts.begin(), texts.end(), [](const std::string& t) {
               return t.starts_with("black box: the cycles before fault 406") &&
                      t.find("/proc/tendril_none") != t.npos;
             }) == faults;
    }));
    Send(ModeRequest::kClear);
    Arm();
  }
  EXPECT_THAT(texts, Contains(HasSubstr("faults will leave no black box")));
  EXPECT_LT(Stop(), 2.0);
}

TEST_F(DaemonTest, RequiredRightsThatAreMissingStopItBeforeAnythingMoves) {
  options.parameters.realtime.required = true;
  options.parameters.realtime.cpu = 100'000;
  int sync = 0;
  drives.bus().SetFilter([&](can::CanFrame& f) {
    sync += f.id == 0x080;
    return true;
  });
  daemon.emplace(options, drives.port());
  try {
    daemon->Run([] { return true; });
    ADD_FAILURE() << "not refused";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(),
                AllOf(HasSubstr("realtime.required is true"), HasSubstr("not bound to cpu 100000")));
  }
  EXPECT_EQ(sync, 0);
}

}  // namespace
}  // namespace tendril::daemon
