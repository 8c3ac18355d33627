#include "loop_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <utility>

namespace tendril::daemon {
namespace {

constexpr std::size_t kMissesKept = 16;

double Us(TimeNs t_ns) { return static_cast<double>(t_ns) / static_cast<double>(kNsPerUs); }

// The cause of a cycle that ended after the next one should have begun.
std::string CauseOfMiss(const CycleTiming& before, const rt::ThreadUsage& usage,
                        const rt::ThreadUsage& earlier) {
  const TimeNs rest_ns = before.total_ns - before.feedback_ns - before.compute_ns;
  const TimeNs most_ns = std::max({before.wake_latency_ns, before.feedback_ns, before.compute_ns, rest_ns});
  std::string cause = most_ns == before.wake_latency_ns ? "woken late"
                      : most_ns == before.feedback_ns   ? "the bus"
                      : most_ns == before.compute_ns    ? "the step"
                                                        : "sending and handing over";
  cause += fmt::format(", {:.0f} us", Us(most_ns));
  if (usage.major_faults + usage.minor_faults > earlier.major_faults + earlier.minor_faults) {
    cause += ", page faults";
  } else if (usage.involuntary_switches > earlier.involuntary_switches) {
    cause += ", preemption";
  }
  return cause;
}

}  // namespace

void LoopReport::Count(const Published& next) {
  const CycleRecord& r = next.record;
  wake_latency_.Add(r.timing.wake_latency_ns);
  round_trip_.Add(r.timing.feedback_ns);
  compute_.Add(r.timing.compute_ns);
  total_.Add(r.timing.total_ns);
  if (const std::uint64_t skipped = r.timing.deadline_misses - last_timing_.deadline_misses; skipped > 0) {
    misses_.push_back({r.input.cycle, skipped, CauseOfMiss(last_timing_, next.usage, last_usage_)});
    if (skipped > worst_miss_.skipped) worst_miss_ = misses_.back();
    if (misses_.size() > kMissesKept) misses_.pop_front();
  }
  statistics_.drives.resize(setups_.size());
  for (std::size_t i = 0; i < statistics_.drives.size(); ++i) {
    DriveStatistics& drive = statistics_.drives[i];
    const DriveFeedback& now = r.input.drive[static_cast<std::size_t>(driven_[i])];
    drive.node_id = setups_[i].node_id;
    drive.state = now.state;
    drive.statusword = now.statusword;
    drive.error_code = now.error_code;
    drive.serial = next.serials[i];
    drive.age_cycles = now.age_cycles;
    drive.worst_age_cycles = std::max(drive.worst_age_cycles, drive.age_cycles);
  }
  can_ = next.can;
  frame_faults_ = next.frame_faults;
  last_timing_ = r.timing;
  last_usage_ = next.usage;
}

LoopStatistics LoopReport::Collect(TimeNs now_ns, const io::Gateway::Counters& lcm) {
  LoopStatistics& s = statistics_;
  const double elapsed_s = ToSeconds(now_ns - s.time_ns);
  s.bus_load = elapsed_s > 0 ? static_cast<double>(can_.bits - reported_bits_) / bitrate_bps_ / elapsed_s : 0;
  reported_bits_ = can_.bits;
  s.time_ns = now_ns;
  s.cycles = wake_latency_.count();
  s.deadline_misses = last_timing_.deadline_misses;
  s.wake_latency = wake_latency_.Statistics();
  s.compute = compute_.Statistics();
  s.round_trip = round_trip_.Statistics();
  s.misses.assign(misses_.begin(), misses_.end());
  s.messages_ignored = lcm.undecodable;
  s.publish_failed = lcm.publish_failed;
  s.can_sent = can_.sent;
  s.can_received = can_.received;
  s.can_send_refused = can_.send_refused;
  s.can_receive_dropped = can_.receive_dropped;
  s.can_error_frames = can_.error_frames;
  s.can_bus_off = can_.bus_off;
  s.can_malformed = frame_faults_.malformed;
  s.can_foreign = frame_faults_.foreign;
  s.voluntary_switches = last_usage_.voluntary_switches;
  s.involuntary_switches = last_usage_.involuntary_switches;
  s.minor_faults = last_usage_.minor_faults;
  s.major_faults = last_usage_.major_faults;
  const LoopStatistics taken = s;
  for (DriveStatistics& drive : s.drives) drive.worst_age_cycles = drive.age_cycles;
  return taken;
}

std::string LoopReport::LatencyText() const {
  return fmt::format(
      "{} cycles, {} missed; median, 99 % and most: wake-up late by {:.1f}, {:.1f}, {:.1f} us; step "
      "{:.1f}, {:.1f}, "
      "{:.1f} us; cycle {:.1f}, {:.1f}, {:.1f} us",
      wake_latency_.count(), last_timing_.deadline_misses, Us(wake_latency_.Percentile(0.5)),
      Us(wake_latency_.Percentile(0.99)), Us(wake_latency_.max_ns()), Us(compute_.Percentile(0.5)),
      Us(compute_.Percentile(0.99)), Us(compute_.max_ns()), Us(total_.Percentile(0.5)),
      Us(total_.Percentile(0.99)), Us(total_.max_ns()));
}

// Logged as well, because they otherwise look like drives that do not answer.
std::optional<std::string> LoopReport::NewMisses() {
  const std::uint64_t now = last_timing_.deadline_misses;
  if (now == misses_told_) return std::nullopt;
  const MissedCycles worst = std::exchange(worst_miss_, {});
  return fmt::format("{} cycle(s) missed, {} since start; most in a row {}, before cycle {}: {}",
                     now - std::exchange(misses_told_, now), now, worst.skipped, worst.cycle, worst.cause);
}

}  // namespace tendril::daemon
