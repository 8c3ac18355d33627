// Logs: what was published is what is read, damage is said by its place and costs only what it covers.
#include "tendril/io/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lcm/eventlog.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <random>
#include <string>
#include <vector>

#include "random_record.h"
#include "tendril/io/client.h"
#include "tendril_lcm/event_t.hpp"
#include "tendril_lcm/run_t.hpp"

namespace tendril::io {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr int kCycles = 200;

struct LogTest : testing::Test {
  LogTest() : folder(fs::temp_directory_path() / ("tendril_log_test_" + std::to_string(getpid()))) {
    fs::create_directories(folder);
    path = folder / "run.lcmlog";
  }
  ~LogTest() override { fs::remove_all(folder); }

  // A run record, then cycles with a command every tenth.
  void Write() {
    SimulatedClock clock;
    Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
    Client client(gateway.lcm(), "TENDRIL");
    LogWriter writer(gateway, path, clock);
    gateway.PublishRun({"robot: 1\n", "daemon: 2\n", "0.1.0", "abc", 42, "host a, process 3"});
    gateway.PublishStatistics({});
    RandomRecords random(kShape, 7);
    for (int i = 0; i < kCycles; ++i) {
      if (i % 10 == 0) {
        Command c;
        c.kind = CommandKind::kMode;
        client.Send(c, 0);
      }
      records.push_back(random.Next());
      records.back().input.cycle = records.back().output.cycle = static_cast<std::uint64_t>(i);
      gateway.PublishState(records.back());
      gateway.PublishCycle(records.back());
      gateway.Handle(0);
      clock.Advance(kNsPerMs);
    }
    EXPECT_EQ(writer.events(), 2U + 2 * kCycles + kCycles / 10);
    EXPECT_EQ(writer.error(), "");
  }

  fs::path folder, path;
  std::vector<CycleRecord> records;
};

void ExpectSamePrefix(const std::vector<CycleRecord>& read, const std::vector<CycleRecord>& written) {
  ASSERT_LE(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) ExpectSameBits(read[i], written[i]);
}

TEST_F(LogTest, CyclesAndRunComeBack) {
  Write();
  const LogContents log = ReadLog(path);
  EXPECT_EQ(log.damage, "");
  EXPECT_EQ(log.run.robot_yaml, "robot: 1\n");
  EXPECT_EQ(log.run.daemon_yaml, "daemon: 2\n");
  EXPECT_EQ(log.run.version, "0.1.0");
  EXPECT_EQ(log.run.git_revision, "abc");
  EXPECT_EQ(log.run.start_utime, 42);
  EXPECT_EQ(log.run.daemon, "host a, process 3");
  ASSERT_EQ(log.cycles.size(), static_cast<std::size_t>(kCycles));
  ExpectSamePrefix(log.cycles, records);
}

// LCM's own reader is the judge of the file, its order and its stamps.
TEST_F(LogTest, OtherLcmToolsCanReadIt) {
  Write();
  lcm_eventlog_t* log = lcm_eventlog_create(path.c_str(), "r");
  ASSERT_NE(log, nullptr);
  int commands = 0, states = 0, cycles = 0, runs = 0;
  std::int64_t last_us = 0, number = 0;
  while (lcm_eventlog_event_t* event = lcm_eventlog_read_next_event(log)) {
    const std::string channel = event->channel;
    commands += channel == "TENDRIL_COMMAND_MODE";
    states += channel == "TENDRIL_STATE";
    cycles += channel == "TENDRIL_CYCLE";
    runs += channel == "TENDRIL_RUN";
    EXPECT_EQ(event->eventnum, number++);
    EXPECT_GE(event->timestamp, last_us);
    last_us = event->timestamp;
    lcm_eventlog_free_event(event);
  }
  lcm_eventlog_destroy(log);
  EXPECT_EQ(commands, kCycles / 10);
  EXPECT_EQ(states, kCycles);
  EXPECT_EQ(cycles, kCycles);
  EXPECT_EQ(runs, 1);
  EXPECT_EQ(last_us, (kCycles - 1) * 1000);
}

// Whoever shares the address may send on a channel without a name; LCM delivers it.
TEST_F(LogTest, AMessageWithoutAChannelCostsNoneOfTheRest) {
  SimulatedClock clock;
  Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
  {
    LogWriter writer(gateway, path, clock);
    RandomRecords random(kShape, 7);
    for (int i = 0; i < 3; ++i) {
      ASSERT_EQ(gateway.lcm()->publish("", "x", 1), 0);
      gateway.Handle(0);
      gateway.PublishCycle(random.Next());
    }
  }
  const LogContents log = ReadLog(path);
  EXPECT_EQ(log.cycles.size(), 3U);
  EXPECT_EQ(log.damage, "");
}

// Robots that share an address have prefixes of their own, and each its own log.
TEST_F(LogTest, WhatAnotherDaemonPublishesIsNotInTheLog) {
  SimulatedClock clock;
  Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
  LogWriter writer(gateway, path, clock);
  const tendril_lcm::run_t other_run{};
  const tendril_lcm::event_t other_event{};
  ASSERT_EQ(gateway.lcm()->publish("OTHER_RUN", &other_run), 0);
  ASSERT_EQ(gateway.lcm()->publish("OTHER_EVENT", &other_event), 0);
  ASSERT_EQ(gateway.lcm()->publish("MINE_RUN", "of another type", 15), 0);
  ASSERT_EQ(gateway.lcm()->publish("SHORT_RUN", "x", 1), 0);
  gateway.Handle(0);
  EXPECT_EQ(writer.events(), 2U) << "what other programs send stays in";
}

// As other LCM tools record two robots on one address.
TEST_F(LogTest, OfALogOfTwoDaemonsTheFirstOneIsRead) {
  Write();
  const std::string both = folder / "both.lcmlog";
  lcm_eventlog_t* from = lcm_eventlog_create(path.c_str(), "r");
  lcm_eventlog_t* to = lcm_eventlog_create(both.c_str(), "w");
  while (lcm_eventlog_event_t* event = lcm_eventlog_read_next_event(from)) {
    ASSERT_EQ(lcm_eventlog_write_event(to, event), 0);
    std::string channel = std::string("OTHER") + std::strchr(event->channel, '_');
    lcm_eventlog_event_t other = *event;
    other.channel = channel.data();
    other.channellen = static_cast<std::int32_t>(channel.size());
    ASSERT_EQ(lcm_eventlog_write_event(to, &other), 0);
    lcm_eventlog_free_event(event);
  }
  lcm_eventlog_destroy(from);
  lcm_eventlog_destroy(to);
  const LogContents log = ReadLog(both);
  ASSERT_EQ(log.cycles.size(), records.size());
  ExpectSamePrefix(log.cycles, records);
  EXPECT_EQ(log.damage, "");
}

// Whoever tidies up is told, and not at the end alone.
TEST_F(LogTest, ALogThatIsDeletedIsTold) {
  SimulatedClock clock;
  Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
  LogWriter writer(gateway, path, clock);
  RandomRecords random(kShape, 7);
  const auto a_second_later = [&] {
    clock.Advance(1100 * kNsPerMs);
    gateway.PublishCycle(random.Next());
  };
  a_second_later();
  a_second_later();
  EXPECT_EQ(writer.error(), "");
  fs::remove(path);
  a_second_later();
  EXPECT_THAT(writer.error(), HasSubstr(path.string() + " no longer exists: it was deleted"));
}

TEST_F(LogTest, ATruncatedLogGivesWhatWasWholeAndSaysSo) {
  Write();
  const auto size = fs::file_size(path);
  std::size_t last = kCycles;
  for (const double share : {0.9, 0.5, 0.1}) {
    fs::resize_file(path, static_cast<std::uintmax_t>(static_cast<double>(size) * share) + 1);
    const LogContents log = ReadLog(path);
    EXPECT_THAT(log.damage, HasSubstr(" at byte ")) << share;
    EXPECT_LT(log.cycles.size(), last);
    EXPECT_GT(log.cycles.size(), static_cast<std::size_t>(kCycles * share) - 10);
    ExpectSamePrefix(log.cycles, records);
    last = log.cycles.size();
  }
}

/// Bytes of the file, changed, and written back.
template <class Change>
void Damage(const fs::path& path, Change change) {
  std::ifstream in(path, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), {});
  change(bytes);
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

/// What is read are records as they were written, in order, and all but `lost` at the most: what is lost may
/// be of other channels.
void ExpectAllBut(std::size_t lost, const std::vector<CycleRecord>& read,
                  const std::vector<CycleRecord>& written) {
  EXPECT_GE(read.size() + lost, written.size());
  EXPECT_LE(read.size(), written.size());
  for (const CycleRecord& record : read) ExpectSameBits(record, written.at(record.input.cycle));
  for (std::size_t i = 1; i < read.size(); ++i) EXPECT_LT(read[i - 1].input.cycle, read[i].input.cycle);
}

TEST_F(LogTest, DamageCostsWhatItCoversAndIsNamed) {
  Write();
  std::ifstream in(path, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(in)), {});
  const std::size_t middle = whole.size() / 2, size = 4000;  // of some five events
  std::mt19937 random(3);
  struct Kind {
    const char* name;
    std::function<void(std::string&)> damage;
    const char* said;
  };
  const std::vector<Kind> kinds{
      {"overwritten", [&](std::string& b) { b.replace(middle, size, size, '\xA5'); },
       "is not followed by another"},
      {"random",
       [&](std::string& b) {
         for (std::size_t i = 0; i < size; ++i) b[middle + i] = static_cast<char>(random());
       },
       "is not followed by another"},
      {"zeros", [&](std::string& b) { b.replace(middle, size, size, '\0'); }, ", zeros from byte "},
      {"hole", [&](std::string& b) { b.erase(middle, size); }, "is not followed by another"},
      {"added", [&](std::string& b) { b.insert(middle, size, 'x'); }, "is not followed by another"},
  };
  for (const Kind& kind : kinds) {
    SCOPED_TRACE(kind.name);
    std::ofstream(path, std::ios::binary | std::ios::trunc) << whole;
    Damage(path, kind.damage);
    const LogContents log = ReadLog(path);
    ExpectAllBut(8, log.cycles, records);
    EXPECT_EQ(log.run.robot_yaml, "robot: 1\n");
    EXPECT_THAT(log.damage, HasSubstr(kind.said));
    EXPECT_THAT(log.damage,
                testing::ContainsRegex("^the event at byte [0-9]+ .*, [0-9]+ events? lost; [0-9]+ events "
                                       "over 0\\.1[0-9]* s are read$"));
    const auto offset = std::stoul(log.damage.substr(std::string("the event at byte ").size()));
    EXPECT_LE(offset, middle);
    EXPECT_GT(offset + 4000, middle);
  }
}

TEST_F(LogTest, DamageAtTheBeginningAndInSeveralPlaces) {
  Write();
  Damage(path, [](std::string& bytes) {
    for (const double share : {0.0, 0.3, 0.8})
      bytes.replace(static_cast<std::size_t>(share * static_cast<double>(bytes.size())), 100, 100, '\xFF');
    bytes.resize(bytes.size() - 10);
  });
  const LogContents log = ReadLog(path);
  ExpectAllBut(6, log.cycles, records);
  EXPECT_EQ(log.run.robot_yaml, "") << "it was the first event";
  EXPECT_THAT(log.damage,
              testing::StartsWith("the event at byte 0 does not begin like an event of an LCM log; "));
  EXPECT_THAT(log.damage, HasSubstr(", to the end"));
}

// An event whose frame is whole, with numbers that no controller writes.
TEST_F(LogTest, ACycleOfZerosIsNoCycle) {
  Write();
  Damage(path, [](std::string& bytes) {
    const std::size_t cycle = bytes.find("TENDRIL_CYCLE", bytes.size() / 2) + 13;
    bytes.replace(cycle + 32, 200, 200, '\0');  // behind the lengths of its arrays
  });
  const LogContents log = ReadLog(path);
  EXPECT_EQ(log.cycles.size(), records.size() - 1);
  ExpectAllBut(1, log.cycles, records);
  EXPECT_THAT(log.damage, HasSubstr("on TENDRIL_CYCLE holds numbers that no controller writes"));
}

TEST_F(LogTest, WhatIsNoLogIsSaidToBeNone) {
  std::ofstream(path) << "this is a text file, and it is longer than the header of one event";
  EXPECT_THAT(ReadLog(path).damage, HasSubstr("does not begin like an event of an LCM log"));
  std::ofstream(path, std::ios::trunc).flush();
  EXPECT_EQ(ReadLog(path).damage, "the file is empty");
}

TEST_F(LogTest, AFileThatIsNoLogIsNotOverwritten) {
  SimulatedClock clock;
  Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
  for (const std::string text : {"name: my_robot\n", "x"}) {
    std::ofstream(path, std::ios::trunc) << text;
    EXPECT_THROW(LogWriter(gateway, path, clock), std::runtime_error);
    EXPECT_THROW(RecordLog(path, kShape, "TENDRIL", 0), std::runtime_error);
    std::string left;
    std::getline(std::ifstream(path), left, '\0');
    EXPECT_EQ(left, text);
  }
  std::ofstream(path, std::ios::trunc).flush();  // as mktemp leaves it
  for (int i = 0; i < 2; ++i) EXPECT_NO_THROW(LogWriter(gateway, path, clock)) << "an older log is replaced";
}

TEST_F(LogTest, PathsThatDoNotWorkAreNamed) {
  const std::string nowhere = folder / "no" / "such.lcmlog";
  SimulatedClock clock;
  Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
  try {
    LogWriter writer(gateway, nowhere, clock);
    ADD_FAILURE() << "no error";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("cannot write log " + nowhere + ": No such file or directory"));
  }
  try {
    ReadLog(nowhere);
    ADD_FAILURE() << "no error";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr(nowhere));
  }
  EXPECT_THROW(ReadLog(folder), std::runtime_error);
}

}  // namespace
}  // namespace tendril::io
