// LCM event logs: writing what passes a gateway, reading cycle records back.
#include "tendril/io/log.h"

#include <lcm/eventlog.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "cycle_check.h"
#include "event_reader.h"
#include "tendril/io/connection.h"
#include "tendril/io/wire.h"

namespace tendril::io {
namespace {

constexpr std::size_t kWriteBuffer_B = std::size_t{1} << 20;
// Upper bound of what a crash of the machine loses.
constexpr std::int64_t kFlushEvery_us = 1'000'000;

/// Opens a new log, in place of an older one; throws std::runtime_error where it cannot, or where the file is
/// something else, such as a robot file named by mistake.
lcm_eventlog_t* NewLog(const std::string& path) {
  constexpr std::string_view kFirst = "\xED\xA1\xDA\x01";
  std::string begin(kFirst.size(), '\0');
  std::ifstream there(path, std::ios::binary);
  std::error_code none;
  if (std::filesystem::is_regular_file(path, none) && there.read(begin.data(), 1) &&
      (!there.read(begin.data() + 1, 3) || begin != kFirst)) {
    throw std::runtime_error("cannot write log " + path +
                             ": the file is there and is no LCM log; give the log another name");
  }
  lcm_eventlog_t* log = lcm_eventlog_create(path.c_str(), "w");
  if (log == nullptr)
    throw std::runtime_error("cannot write log " + path + ": " + std::strerror(errno) +
                             "; name a file in an existing folder you may write to");
  return log;
}

// What a daemon publishes, by the fingerprint with which LCM begins every message.
bool IsOfADaemon(const void* data, std::size_t size) {
  using namespace tendril_lcm;
  static const std::array<std::int64_t, 6> kinds = {state_t::getHash(),      cycle_t::getHash(),
                                                    run_t::getHash(),        event_t::getHash(),
                                                    statistics_t::getHash(), snapshot_t::getHash()};
  std::int64_t kind = 0;
  if (__int64_t_decode_array(data, 0, static_cast<int>(size), &kind, 1) < 0) return false;
  return std::find(kinds.begin(), kinds.end(), kind) != kinds.end();
}

}  // namespace

struct LogWriter::State {
  State(Gateway& log_gateway, const Clock& log_clock)
      : gateway(log_gateway),
        clock(log_clock),
        epoch_offset_us(EpochOffsetUs(log_clock)),
        lcm(log_gateway.lcm()->getUnderlyingLCM()) {}

  void Write(const char* channel, std::size_t channel_size, const void* data, int size) {
    if (!IsEvent(channel_size, static_cast<std::uint64_t>(size))) return;
    lcm_eventlog_event_t event{};
    event.timestamp = clock.Now() / kNsPerUs + epoch_offset_us;
    event.channellen = static_cast<std::int32_t>(channel_size);
    event.datalen = size;
    // The log's struct has no const members; writing does not change them.
    event.channel = const_cast<char*>(channel);
    event.data = const_cast<void*>(data);
    if (lcm_eventlog_write_event(log, &event) != 0) Failed();
    if (event.timestamp - flushed_us >= kFlushEvery_us) {
      flushed_us = event.timestamp;
      if (std::fflush(log->f) != 0) Failed();
      if (error.empty() && !IsThere())
        error = "log " + path + " no longer exists: it was deleted, or moved and is written at its new place";
    }
  }

  bool IsThere() const {
    struct stat named {
    }, written{};
    if (stat(path.c_str(), &named) != 0) return errno != ENOENT;
    return fstat(fileno(log->f), &written) != 0 ||
           (named.st_dev == written.st_dev && named.st_ino == written.st_ino);
  }

  void Failed() {
    if (error.empty())
      error = "cannot write log " + path + ": " + std::strerror(errno) + "; it is incomplete";
  }

  Gateway& gateway;
  const Clock& clock;
  std::int64_t epoch_offset_us;
  lcm_t* lcm;
  lcm_subscription_t* subscription = nullptr;
  lcm_eventlog_t* log = nullptr;
  std::vector<char> file_buffer = std::vector<char>(kWriteBuffer_B);
  std::int64_t flushed_us = 0;
  std::string path, error;
};

LogWriter::LogWriter(Gateway& gateway, const std::string& path, const Clock& clock)
    : state_(std::make_unique<State>(gateway, clock)) {
  State& s = *state_;
  s.path = path;
  s.log = NewLog(path);
  std::setvbuf(s.log->f, s.file_buffer.data(), _IOFBF, s.file_buffer.size());
  gateway.SetTap([state = state_.get()](const std::string& channel, const void* data, int size) {
    state->Write(channel.data(), channel.size(), data, size);
  });
  // The gateway's own channels arrive through the tap; subscribing to them would cost a copy per message.
  // What daemons of other robots publish on the same address is no part of this robot's log.
  const std::string others = "(?!" + gateway.channel_prefix() + "_(STATE|CYCLE|RUN|EVENT|STATISTICS)$).*";
  s.subscription = lcm_subscribe(
      s.lcm, others.c_str(),
      [](const lcm_recv_buf_t* bytes, const char* channel, void* state) {
        if (IsOfADaemon(bytes->data, bytes->data_size)) return;
        static_cast<State*>(state)->Write(channel, std::strlen(channel), bytes->data,
                                          static_cast<int>(bytes->data_size));
      },
      &s);
}

LogWriter::~LogWriter() {
  State& s = *state_;
  s.gateway.SetTap({});
  if (s.subscription != nullptr) lcm_unsubscribe(s.lcm, s.subscription);
  lcm_eventlog_destroy(s.log);
}

std::uint64_t LogWriter::events() const { return static_cast<std::uint64_t>(state_->log->eventcount); }
std::string LogWriter::error() const { return state_->error; }

struct RecordLog::State {
  template <class Message>
  void Write(const std::string& channel, const Message& message, std::int64_t utime) {
    bytes.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    lcm_eventlog_event_t event{};
    event.timestamp = utime;
    event.channellen = static_cast<std::int32_t>(channel.size());
    event.datalen = static_cast<std::int32_t>(bytes.size());
    event.channel = const_cast<char*>(channel.data());
    event.data = bytes.data();
    if (lcm_eventlog_write_event(log, &event) != 0) Failed();
  }
  std::int64_t UtimeOf(TimeNs time_ns) const { return time_ns / kNsPerUs + epoch_offset_us; }
  void Failed() {
    if (error.empty()) error = "cannot write log " + path + ": " + std::strerror(errno);
  }

  std::string path, run_channel, snapshot_channel, cycle_channel, error;
  RobotShape shape;
  std::int64_t epoch_offset_us = 0;
  lcm_eventlog_t* log = nullptr;
  std::vector<std::uint8_t> bytes;
  tendril_lcm::cycle_t cycle{};
};

RecordLog::RecordLog(const std::string& path, const RobotShape& shape, const std::string& channel_prefix,
                     std::int64_t epoch_offset_us)
    : state_(std::make_unique<State>()) {
  State& s = *state_;
  s.path = path;
  s.run_channel = ChannelName(channel_prefix, "RUN");
  s.snapshot_channel = ChannelName(channel_prefix, "SNAPSHOT");
  s.cycle_channel = ChannelName(channel_prefix, "CYCLE");
  s.shape = shape;
  s.epoch_offset_us = epoch_offset_us;
  s.log = NewLog(path);
}

RecordLog::~RecordLog() { Close(); }

void RecordLog::Run(const RunInfo& run, TimeNs time_ns) {
  tendril_lcm::run_t message{};
  ToMessage(run, state_->shape, state_->UtimeOf(time_ns), message);
  state_->Write(state_->run_channel, message, message.utime);
}

void RecordLog::Snapshot(std::uint64_t next_cycle, TimeNs time_ns, std::span<const std::byte> state) {
  tendril_lcm::snapshot_t message{};
  message.num_bytes = static_cast<std::int32_t>(state.size());
  message.utime = state_->UtimeOf(time_ns);
  message.next_cycle = static_cast<std::int64_t>(next_cycle);
  message.state.resize(state.size());
  std::memcpy(message.state.data(), state.data(), state.size());
  state_->Write(state_->snapshot_channel, message, message.utime);
}

void RecordLog::Cycle(const CycleRecord& record) {
  State& s = *state_;
  const std::int64_t utime = s.UtimeOf(record.input.time_ns);
  ToMessage(record, s.shape, utime, s.cycle);
  s.Write(s.cycle_channel, s.cycle, utime);
}

std::string RecordLog::Close() {
  State& s = *state_;
  if (s.log != nullptr) {
    if (std::fflush(s.log->f) != 0) s.Failed();
    lcm_eventlog_destroy(s.log);
    s.log = nullptr;
  }
  return s.error;
}

namespace {

// The prefix of a channel with records of a daemon ("TENDRIL" of TENDRIL_CYCLE); empty for any other channel.
std::string_view PrefixOfRecords(std::string_view channel) {
  for (const std::string_view ending : {"_CYCLE", "_RUN", "_SNAPSHOT"}) {
    if (channel.ends_with(ending)) return channel.substr(0, channel.size() - ending.size());
  }
  return {};
}

// The first prefix with two records: one record alone may have its name from damaged bytes.
std::string PrefixOfLog(const std::string& path) {
  EventReader reader(path);
  std::set<std::string, std::less<>> seen;
  std::string first;
  while (reader.Next()) {
    const std::string prefix(PrefixOfRecords(reader.channel()));
    if (prefix.empty()) continue;
    if (!seen.insert(prefix).second) return prefix;
    if (first.empty()) first = prefix;
  }
  return first;
}

}  // namespace

std::string StreamLog(const std::string& path, const std::function<void(const RunInfo&)>& run,
                      const std::function<void(const CycleRecord&, std::uint64_t offset)>& cycle,
                      const std::function<void(const StateSnapshot&)>& snapshot) {
  const std::string prefix = PrefixOfLog(path);
  EventReader reader(path);
  CycleCheck check;
  tendril_lcm::cycle_t cycle_message{};
  tendril_lcm::run_t run_message{};
  tendril_lcm::snapshot_t snapshot_message{};
  while (reader.Next()) {
    const std::string_view channel = reader.channel();
    if (PrefixOfRecords(channel) != prefix) continue;
    const void* data = reader.data().data();
    const int size = static_cast<int>(reader.data().size());
    const auto refuse = [&](const char* kind) {
      reader.Refuse("on " + reader.channel() + " is not a " + kind + " message of this version's lcm_types");
    };
    if (cycle && channel.ends_with("_CYCLE")) {
      CycleRecord record;
      if (!Decode(data, size, cycle_message) || !FromMessage(cycle_message, record)) {
        refuse("cycle");
      } else if (!check.Possible(cycle_message)) {
        reader.Refuse("on " + reader.channel() + " holds numbers that no controller writes");
      } else {
        cycle(record, reader.offset());
      }
    } else if (run && channel.ends_with("_RUN")) {
      if (!Decode(data, size, run_message)) {
        refuse("run");
        continue;
      }
      RunInfo info;
      FromMessage(run_message, info);
      run(info);
    } else if (snapshot && channel.ends_with("_SNAPSHOT")) {
      if (!Decode(data, size, snapshot_message)) {
        refuse("snapshot");
        continue;
      }
      const auto state = std::as_bytes(std::span(snapshot_message.state));
      snapshot({static_cast<std::uint64_t>(snapshot_message.next_cycle), {state.begin(), state.end()}});
    }
  }
  return reader.Damage();
}

LogContents ReadLog(const std::string& path) {
  LogContents contents;
  contents.damage = StreamLog(
      path, [&](const RunInfo& run) { contents.run = run; },
      [&](const CycleRecord& cycle, std::uint64_t offset) {
        contents.cycles.push_back(cycle);
        contents.offsets.push_back(offset);
      });
  return contents;
}

}  // namespace tendril::io
