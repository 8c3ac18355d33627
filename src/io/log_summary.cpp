#include "tendril/io/log_summary.h"

#include <algorithm>
#include <map>
#include <string_view>

#include "event_reader.h"
#include "tendril/io/log_messages.h"
#include "tendril/io/wire.h"

namespace tendril::io {
namespace {

/// Counts the cycles that are missing between the first and last of each start of a daemon.
class CycleCount {
 public:
  void Take(std::int64_t cycle) {
    if (count_ > 0 && cycle > last_) {
      const std::int64_t step = cycle - last_;
      span_ += step;
      smallest_ = smallest_ == 0 ? step : std::min(smallest_, step);
    } else {
      ++starts_;
    }
    last_ = cycle;
    ++count_;
  }
  /// The smallest step between two cycles is that of the recording.
  std::uint64_t Missing() const {
    if (smallest_ == 0) return 0;
    return static_cast<std::uint64_t>(std::max<std::int64_t>(0, span_ / smallest_ + starts_ - count_));
  }

 private:
  std::int64_t last_ = 0, count_ = 0, span_ = 0, starts_ = 0, smallest_ = 0;
};

class Summary {
 public:
  explicit Summary(double least_gap_s) : least_gap_us_(static_cast<std::int64_t>(1e6 * least_gap_s)) {}

  void Take(const LogMessage& message) {
    TakeTime(message.stamp_us);
    ChannelSummary& channel = channels_[message.channel];
    if (channel.messages == 0) {
      channel.first_us = channel.last_us = message.stamp_us;
      channel.name = message.channel;
      channel.type = message.type;
    } else if (message.stamp_us < channel.last_us) {
      ++channel.earlier;
    } else if (message.stamp_us - channel.last_us > channel.longest.end_us - channel.longest.begin_us) {
      channel.longest = {channel.last_us, message.stamp_us};
    }
    channel.last_us = std::max(channel.last_us, message.stamp_us);
    ++channel.messages;
    channel.bytes += message.data.size();
    const void* data = message.data.data();
    const int size = static_cast<int>(message.data.size());
    if (message.type == "cycle_t" && Decode(data, size, cycle_)) cycles_[message.channel].Take(cycle_.cycle);
    if (message.type == "run_t" && Decode(data, size, run_)) TakeRun(message.channel);
  }

  LogSummary Finish() {
    for (auto& [name, channel] : channels_) {
      if (const auto found = cycles_.find(name); found != cycles_.end())
        channel.missing_cycles = found->second.Missing();
      summary_.channels.push_back(channel);
    }
    return std::move(summary_);
  }

 private:
  void TakeTime(std::int64_t stamp_us) {
    LogSummary& s = summary_;
    if (s.messages++ == 0) {
      s.first_us = s.last_us = stamp_us;
    } else if (stamp_us - s.last_us >= least_gap_us_) {
      if (++s.gaps <= kGapsKept) s.first_gaps.push_back({s.last_us, stamp_us});
    }
    s.first_us = std::min(s.first_us, stamp_us);
    s.last_us = std::max(s.last_us, stamp_us);
  }

  void TakeRun(const std::string& channel) {
    const std::string prefix = channel.substr(0, channel.rfind('_'));
    const auto same = [&](const LoggedRun& run) {
      return run.prefix == prefix && run.info.start_utime == run_.start_utime &&
             run.info.robot_yaml == run_.robot_yaml;
    };
    if (std::any_of(summary_.runs.begin(), summary_.runs.end(), same)) return;
    summary_.runs.push_back({prefix, {}});
    FromMessage(run_, summary_.runs.back().info);
  }

  std::int64_t least_gap_us_;
  LogSummary summary_;
  std::map<std::string, ChannelSummary> channels_;
  std::map<std::string, CycleCount> cycles_;
  tendril_lcm::cycle_t cycle_{};
  tendril_lcm::run_t run_{};
};

}  // namespace

double ChannelSummary::rate_per_s() const {
  if (last_us <= first_us) return 0;
  return static_cast<double>(messages - 1) / (1e-6 * static_cast<double>(last_us - first_us));
}

LogSummary SummariseLog(const std::string& path, double least_gap_s,
                        const std::function<void(double)>& progress) {
  LogMessages log(path);
  Summary summary(least_gap_s);
  for (std::uint64_t n = 0; log.Next(); ++n) {
    summary.Take(log.message());
    if (progress && n % kEventsAReport == 0)
      progress(static_cast<double>(log.position()) / static_cast<double>(log.size()));
  }
  LogSummary result = summary.Finish();
  result.file_bytes = log.size();
  result.damage = log.Damage();
  return result;
}

}  // namespace tendril::io
