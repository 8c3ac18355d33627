// LCM in and out: decodes and stamps command messages, encodes state, cycle, run and event messages. Runs on
// the calling, non-real-time thread; the daemon has a separate thread for it. Knows nothing of control.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/core/daemon.h"
#include "tendril/core/statistics.h"

namespace lcm {
class LCM;
}

namespace tendril::io {

/// Sizes and static facts repeated in messages.
struct RobotShape {
  int sections = 0, units = 0, tendons = 0;
};

struct RunInfo {
  std::string robot_yaml, daemon_yaml;  // resolved
  std::string version, git_revision;
  std::int64_t start_utime = 0;  // microseconds since the epoch
  /// Identity of the daemon: host, process, robot and bus in one line; empty: none, a run in one process.
  std::string daemon = {};
};

class Gateway {
 public:
  using CommandSink = std::function<void(const Command&)>;
  using TrackerSink = std::function<void(const TrackerSample&)>;
  using RunSink = std::function<void(const RunInfo&)>;
  using ComplaintSink = std::function<void(Status, const std::string& text)>;

  /// Opens LCM. Throws std::runtime_error with the remedy when the URL does not work (for udpm: no multicast
  /// route).
  Gateway(const LcmParameters& lcm, const RobotShape& shape, const Clock& clock);
  ~Gateway();

  /// Called in Handle; must not throw.
  void OnCommand(CommandSink sink);
  void OnTracker(TrackerSink sink);
  /// Called with every run record on this gateway's channels, including its own where LCM loops them back.
  void OnRun(RunSink sink);
  /// Called with events of the gateway itself, at most once per second: ignored messages and the reason.
  void OnComplaint(ComplaintSink sink);

  /// Handles waiting messages for at most timeout_ms; returns how many.
  int Handle(int timeout_ms);

  void PublishRun(const RunInfo& run);
  /// Call with every cycle: publishes every state_every_cycles-th and each in which a command arrived or mode
  /// or status changed. `why`: the reason and remedy of a command refused in this cycle, where more specific
  /// than its status. `detail` is appended to the text of the state's status, for example the drive and
  /// object.
  void PublishState(const CycleRecord& record, const std::string& why = {}, const std::string& detail = {});
  /// Call with every cycle: publishes every cycle_every_cycles-th.
  void PublishCycle(const CycleRecord& record);
  void PublishStatistics(const LoopStatistics& statistics);
  void PublishEvent(TimeNs time_ns, Status status, const std::string& source, const std::string& text);

  struct Counters {
    std::uint64_t received = 0, undecodable = 0, published = 0, publish_failed = 0;
  };
  Counters counters() const;

  /// Called with each encoded message of this gateway as it is published, so that a recorder need not
  /// subscribe.
  using Tap = std::function<void(const std::string& channel, const void* data, int size)>;
  void SetTap(Tap tap);
  const std::string& channel_prefix() const;

  /// The connection itself, for programs that listen or log on it (the only access with memq://).
  lcm::LCM* lcm() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::io
