// What a log is said to hold is what was written into it; a part of a log is what lies in it, bit for bit.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lcm/eventlog.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "random_record.h"
#include "tendril/io/log.h"
#include "tendril/io/log_cut.h"
#include "tendril/io/log_messages.h"
#include "tendril/io/log_summary.h"

namespace tendril::io {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kWritten = 300, kSilentBefore = 200, kLost = 10;

struct Event {
  std::string channel, data;
  std::int64_t stamp_us = 0;
  bool operator==(const Event&) const = default;
};

// LCM's own reader is the judge of a log.
std::vector<Event> EventsOf(const std::string& path) {
  std::vector<Event> events;
  lcm_eventlog_t* log = lcm_eventlog_create(path.c_str(), "r");
  if (log == nullptr) return events;
  while (lcm_eventlog_event_t* event = lcm_eventlog_read_next_event(log)) {
    events.push_back({{event->channel, static_cast<std::size_t>(event->channellen)},
                      {static_cast<const char*>(event->data), static_cast<std::size_t>(event->datalen)},
                      event->timestamp});
    lcm_eventlog_free_event(event);
  }
  lcm_eventlog_destroy(log);
  return events;
}

struct LogPartsTest : testing::Test {
  LogPartsTest() : folder(fs::temp_directory_path() / ("tendril_log_parts_" + std::to_string(getpid()))) {
    fs::create_directories(folder);
    path = folder / "run.lcmlog";
    out = folder / "cut.lcmlog";
    Write();
  }
  ~LogPartsTest() override { fs::remove_all(folder); }

  /// A cycle every millisecond, a state every other, two seconds of silence, and cycles whose numbers are
  /// missing.
  void Write() {
    SimulatedClock clock;
    Gateway gateway({"memq://", "TENDRIL", 1, 1}, kShape, clock);
    LogWriter writer(gateway, path, clock);
    gateway.PublishRun({"robot: 1\n", "daemon: 2\n", "0.1.0", "abc", 42, "host a, process 3"});
    EXPECT_EQ(gateway.lcm()->publish("CAMERA", "of another program", 18), 0);
    gateway.Handle(0);
    RandomRecords random(kShape, 7);
    for (int i = 0; i < kWritten; ++i) {
      clock.Advance(i == kSilentBefore ? 2000 * kNsPerMs : kNsPerMs);
      CycleRecord record = random.Next();
      record.input.time_ns = record.output.time_ns = clock.Now();
      record.input.cycle = record.output.cycle = static_cast<std::uint64_t>(i < 100 ? i : i + kLost);
      if (i % 2 == 0) gateway.PublishState(record);
      gateway.PublishCycle(record);
    }
  }

  std::vector<std::string> Files() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
    return names;
  }

  fs::path folder, path, out;
};

const ChannelSummary& Find(const LogSummary& log, const std::string& name) {
  for (const ChannelSummary& channel : log.channels) {
    if (channel.name == name) return channel;
  }
  throw std::out_of_range(name);
}

TEST_F(LogPartsTest, SummaryCountsWhatWasWritten) {
  const LogSummary log = SummariseLog(path, 1);
  EXPECT_EQ(log.messages, EventsOf(path).size());
  EXPECT_EQ(log.file_bytes, fs::file_size(path));
  EXPECT_EQ(log.damage, "");
  const ChannelSummary& cycles = Find(log, "TENDRIL_CYCLE");
  EXPECT_EQ(cycles.type, "cycle_t");
  EXPECT_EQ(cycles.messages, static_cast<std::uint64_t>(kWritten));
  EXPECT_EQ(cycles.missing_cycles, static_cast<std::uint64_t>(kLost));
  EXPECT_DOUBLE_EQ(cycles.longest.seconds(), 2);
  EXPECT_NEAR(cycles.rate_per_s(), (kWritten - 1) / (1e-3 * (kWritten - 2) + 2), 1e-9);
  EXPECT_EQ(Find(log, "TENDRIL_STATE").type, "state_t");
  EXPECT_EQ(Find(log, "CAMERA").type, "");
  ASSERT_EQ(log.runs.size(), 1U);
  EXPECT_EQ(log.runs[0].prefix, "TENDRIL");
  EXPECT_EQ(log.runs[0].info.git_revision, "abc");
  ASSERT_EQ(log.gaps, 1U);
  EXPECT_EQ(log.first_gaps[0].begin_us, 1000 * kSilentBefore);
  EXPECT_DOUBLE_EQ(log.first_gaps[0].seconds(), 2);
  EXPECT_EQ(SummariseLog(path, 2.001).gaps, 0U);
}

TEST_F(LogPartsTest, DamageIsNamedByItsByteAndCostsOnlyWhatItCovers) {
  const std::vector<Event> all = EventsOf(path);
  constexpr int kAt = 50'000, kZeros = 3000;  // more than an event
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(kAt);
  file.write(std::string(kZeros, '\0').data(), kZeros);
  file.close();
  const LogSummary log = SummariseLog(path, 1);
  EXPECT_THAT(log.damage, HasSubstr("the event at byte "));
  EXPECT_THAT(log.messages, testing::AllOf(testing::Lt(all.size()), testing::Ge(all.size() - 8)));
  const CutResult cut = CutLog(path, {0, {}}, out);
  EXPECT_EQ(cut.damage, log.damage);
  EXPECT_EQ(SummariseLog(out, 1).damage, "");
  EXPECT_EQ(EventsOf(out).size(), log.messages);
}

/// Where each event of the log begins.
std::vector<std::streamoff> OffsetsOf(const std::string& path) {
  std::vector<std::streamoff> offsets;
  std::streamoff at = 0;
  for (const Event& event : EventsOf(path)) {
    offsets.push_back(at);
    at += static_cast<std::streamoff>(28 + event.channel.size() + event.data.size());
  }
  return offsets;
}

TEST_F(LogPartsTest, AStampFarFromThoseAroundItIsDamage) {
  const LogSummary whole = SummariseLog(path, 1);
  const std::vector<std::streamoff> offsets = OffsetsOf(path);
  for (const std::size_t k : {std::size_t{0}, std::size_t{50}, std::size_t{120}}) {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(offsets[k] + 12);
    file.write(k == 120 ? "\x80\0\0\0\0\0\0\0" : "\0\x7f\0\0\0\0\0\0", 8);
  }
  const LogSummary log = SummariseLog(path, 1);
  EXPECT_EQ(log.messages, whole.messages - 3);
  EXPECT_NEAR(log.seconds(), whole.seconds(), 2e-3);
  EXPECT_EQ(log.gaps, whole.gaps);
  EXPECT_THAT(log.damage, HasSubstr("the event at byte 0 is stamped apart from those around it"));
  EXPECT_THAT(log.damage, HasSubstr(fmt::format("{} events over 2.", log.messages)));
  const CutResult cut = CutLog(path, {0.05, 0.1}, out);
  EXPECT_NEAR(cut.from_s, 0.05, 2e-3);
  EXPECT_NEAR(cut.to_s, 0.1, 2e-3);
}

TEST_F(LogPartsTest, EventsThatWereTakenOutArePutOnRecord) {
  const std::vector<std::streamoff> offsets = OffsetsOf(path);
  std::string bytes;
  {
    std::ifstream file(path, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(file), {});
  }
  bytes.erase(static_cast<std::size_t>(offsets[50]), static_cast<std::size_t>(offsets[53] - offsets[50]));
  std::ofstream(path, std::ios::binary) << bytes;
  EXPECT_THAT(SummariseLog(path, 1).damage,
              HasSubstr(fmt::format("the event at byte {} does not follow the one before it, 3 events lost",
                                    static_cast<long>(offsets[50]))));
}

// A computer without a clock of its own begins in 1970 until it hears from the network.
TEST_F(LogPartsTest, AClockThatIsSetIsNoDamage) {
  const std::size_t all = EventsOf(path).size();
  const std::vector<std::streamoff> offsets = OffsetsOf(path);
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  for (std::size_t k = 100; k < all; ++k) {
    file.seekp(offsets[k] + 12);
    file.write("\0\x06", 2);
  }
  file.close();
  const LogSummary log = SummariseLog(path, 1);
  EXPECT_EQ(log.messages, all);
  EXPECT_EQ(log.damage, "");
}

TEST_F(LogPartsTest, ACutHoldsTheSpanBehindItsRun) {
  const std::vector<Event> all = EventsOf(path);
  const std::int64_t first = all.front().stamp_us;
  std::vector<Event> expected;
  for (const Event& event : all) {
    if (event.stamp_us >= first + 50'000 && event.stamp_us <= first + 80'000) expected.push_back(event);
  }
  ASSERT_GT(expected.size(), 40U);
  const CutResult result = CutLog(path, {0.05, 0.08}, out);
  std::vector<Event> cut = EventsOf(out);
  EXPECT_EQ(result.messages, expected.size());
  EXPECT_EQ(result.of, all.size());
  EXPECT_DOUBLE_EQ(result.from_s, 0.05);
  EXPECT_DOUBLE_EQ(result.to_s, 0.08);
  ASSERT_EQ(cut.size(), expected.size() + 1);
  EXPECT_EQ(cut[0].channel, "TENDRIL_RUN");
  EXPECT_EQ(cut[0].stamp_us, expected[0].stamp_us);
  cut.erase(cut.begin());
  EXPECT_EQ(cut, expected);
  EXPECT_EQ(ReadLog(out).run.robot_yaml, "robot: 1\n");
}

TEST_F(LogPartsTest, ACutOfAllIsTheLog) {
  CutLog(path, {}, out);
  EXPECT_EQ(EventsOf(out), EventsOf(path));
}

TEST_F(LogPartsTest, NoHalfOfACutIsLeft) {
  EXPECT_THROW(CutLog(path, {100, {}}, out), std::runtime_error) << "nothing lies there";
  EXPECT_THROW(CutLog(path, {}, folder / "none" / "cut.lcmlog"), std::runtime_error);
  EXPECT_THROW(CutLog(path, {}, out,
                      [](double share) {
                        if (share >= 0.5) throw std::runtime_error("interrupted");
                      }),
               std::runtime_error);
  EXPECT_THAT(Files(), ElementsAre("run.lcmlog"));
}

TEST_F(LogPartsTest, ACutReplacesNeitherItsLogNorAnotherOnesPart) {
  const std::string part = out.string() + ".part";
  std::filesystem::copy_file(path, part);
  EXPECT_THROW(CutLog(part, {}, out), std::runtime_error);
  EXPECT_EQ(std::filesystem::file_size(part), std::filesystem::file_size(path));
  std::filesystem::remove(part);
  EXPECT_THROW(CutLog(path, {}, path), std::runtime_error);
  EXPECT_NO_THROW(CutLog(path, {}, out));
}

TEST_F(LogPartsTest, MessagesThatAreNoneOfTheirTypeAreDamage) {
  std::vector<Event> events = EventsOf(path);
  lcm_eventlog_t* log = lcm_eventlog_create(out.c_str(), "w");
  for (Event& event : events) {
    if (event.channel == "TENDRIL_STATE" && event.stamp_us == 11'000)
      event.data.resize(event.data.size() - 1);
    lcm_eventlog_event_t raw{};
    raw.timestamp = event.stamp_us;
    raw.channel = event.channel.data();
    raw.channellen = static_cast<std::int32_t>(event.channel.size());
    raw.data = event.data.data();
    raw.datalen = static_cast<std::int32_t>(event.data.size());
    lcm_eventlog_write_event(log, &raw);
  }
  lcm_eventlog_destroy(log);
  LogMessages messages(out);
  std::size_t count = 0;
  while (messages.Next()) {
    EXPECT_EQ(messages.message().type, TypeOfMessage(messages.message().data));
    ++count;
  }
  EXPECT_EQ(count, events.size() - 1);
  EXPECT_THAT(messages.Damage(), HasSubstr("on TENDRIL_STATE is no whole state_t"));
}

}  // namespace
}  // namespace tendril::io
