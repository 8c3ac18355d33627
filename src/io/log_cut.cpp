#include "tendril/io/log_cut.h"

#include <fmt/core.h>
#include <lcm/eventlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "event_reader.h"
#include "tendril/io/log_messages.h"

namespace tendril::io {
namespace {

/// A log under a name of its own until it is complete, so that no half of it is taken for the whole.
class CutFile {
 public:
  explicit CutFile(const std::string& path)
      : path_(path), part_(path + ".part"), log_(lcm_eventlog_create(part_.c_str(), "w")) {
    if (!log_) Fail("name a file in an existing folder you may write to");
  }
  ~CutFile() {
    if (!log_) return;
    log_.reset();
    std::remove(part_.c_str());
  }
  void Write(const std::string& channel, std::int64_t stamp_us, std::span<const std::uint8_t> data) {
    lcm_eventlog_event_t event{};
    event.timestamp = stamp_us;
    event.channellen = static_cast<std::int32_t>(channel.size());
    event.datalen = static_cast<std::int32_t>(data.size());
    // The log's struct has no const members; writing does not change them.
    event.channel = const_cast<char*>(channel.data());
    event.data = const_cast<std::uint8_t*>(data.data());
    if (lcm_eventlog_write_event(log_.get(), &event) != 0) Fail("it is not kept; make room");
  }
  void Finish() {
    if (std::fflush(log_->f) != 0 || fsync(fileno(log_->f)) != 0) Fail("it is not kept; make room");
    if (std::rename(part_.c_str(), path_.c_str()) != 0) Fail("it is not kept");
    log_.reset();
  }

 private:
  [[noreturn]] void Fail(const char* remedy) const {
    throw std::runtime_error(fmt::format("cannot write log {}: {}; {}", path_, std::strerror(errno), remedy));
  }
  struct Closer {
    void operator()(lcm_eventlog_t* log) const noexcept { lcm_eventlog_destroy(log); }
  };
  std::string path_, part_;
  std::unique_ptr<lcm_eventlog_t, Closer> log_;
};

/// The stamp from which seconds count: the earliest, though messages of several senders may come out of
/// order.
std::pair<std::int64_t, std::int64_t> Stamps(const std::string& path,
                                             const std::function<void(double)>& progress) {
  EventReader reader(path);
  std::int64_t first = std::numeric_limits<std::int64_t>::max(), last = 0;
  for (std::uint64_t n = 0; reader.Next(); ++n) {
    first = std::min(first, reader.stamp_us());
    last = std::max(last, reader.stamp_us());
    if (progress && n % kEventsAReport == 0)
      progress(0.5 * static_cast<double>(reader.offset()) / static_cast<double>(reader.size()));
  }
  if (first > last) throw std::runtime_error(path + ": no whole event of an LCM log in this file");
  return {first, last};
}

}  // namespace

CutResult CutLog(const std::string& path, const LogSpan& span, const std::string& out,
                 const std::function<void(double)>& progress) {
  std::error_code none;
  if (std::filesystem::exists(out + ".part", none))  // as of a black box that was cut off
    throw std::runtime_error(out + ".part exists and would be lost; move it, or name another file");
  if (std::filesystem::equivalent(path, out, none))
    throw std::runtime_error(out + " is the log that is read; name another file");
  const auto [first, last] = Stamps(path, progress);
  const auto stamp = [first = first](double seconds) { return first + std::llround(1e6 * seconds); };
  const std::int64_t from = span.from_s ? stamp(*span.from_s) : first;
  const std::int64_t to = span.to_s ? stamp(*span.to_s) : last;

  LogMessages log(path);
  CutFile cut(out);
  CutResult result;
  std::map<std::string, std::vector<std::uint8_t>> runs_before;
  std::int64_t begin = 0, end = 0;
  for (; log.Next(); ++result.of) {
    const LogMessage& m = log.message();
    if (progress && result.of % kEventsAReport == 0)
      progress(0.5 + 0.5 * static_cast<double>(log.position()) / static_cast<double>(log.size()));
    if (m.stamp_us < from && m.type == "run_t") runs_before[m.channel].assign(m.data.begin(), m.data.end());
    if (m.stamp_us < from || m.stamp_us > to) continue;
    if (result.messages++ == 0) {
      begin = end = m.stamp_us;
      for (const auto& [channel, data] : runs_before) cut.Write(channel, m.stamp_us, data);
    }
    cut.Write(m.channel, m.stamp_us, m.data);
    begin = std::min(begin, m.stamp_us);
    end = std::max(end, m.stamp_us);
  }
  if (result.messages == 0)
    throw std::runtime_error(fmt::format("{}: no message in this span; the log has 0 to {:.6g} s", path,
                                         1e-6 * static_cast<double>(last - first)));
  cut.Finish();
  result.from_s = 1e-6 * static_cast<double>(begin - first);
  result.to_s = 1e-6 * static_cast<double>(end - first);
  result.damage = log.Damage();
  return result;
}

}  // namespace tendril::io
