// LCM in and out: decodes and stamps command messages, encodes state, cycle, run and event messages. Runs on
// whatever non-real-time thread calls it; the daemon gives it one of its own. Knows nothing of control.
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

/// Sizes and static facts that messages repeat.
struct RobotShape {
  int sections = 0, units = 0, tendons = 0;
};

struct RunInfo {
  std::string robot_yaml, daemon_yaml;  // resolved
  std::string version, git_revision;
  std::int64_t start_utime = 0;  // microseconds since the epoch
  /// Which daemon this is: host, process, robot and bus in one line; empty: none, a run in one process.
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
  /// Every run record on this gateway's channels, its own ones included where LCM brings them back.
  void OnRun(RunSink sink);
  /// What the gateway tells by an event of its own, at most once a second: messages that it ignored, and why.
  void OnComplaint(ComplaintSink sink);

  /// Handles waiting messages for at most timeout_ms; returns how many.
  int Handle(int timeout_ms);

  void PublishRun(const RunInfo& run);
  /// Call with every cycle: publishes every state_every_cycles-th and each in which a command arrived or mode
  /// or status changed. `why` a command of this cycle was refused, with the remedy, where more is known than
  /// its status tells. `detail` follows the text of the state's status, for example which drive and object.
  void PublishState(const CycleRecord& record, const std::string& why = {}, const std::string& detail = {});
  /// Call with every cycle: publishes every cycle_every_cycles-th.
  void PublishCycle(const CycleRecord& record);
  void PublishStatistics(const LoopStatistics& statistics);
  void PublishEvent(TimeNs time_ns, Status status, const std::string& source, const std::string& text);

  struct Counters {
    std::uint64_t received = 0, undecodable = 0, published = 0, publish_failed = 0;
  };
  Counters counters() const;

  /// Sees each message of this gateway as it is published, encoded: a recorder need not listen to it.
  using Tap = std::function<void(const std::string& channel, const void* data, int size)>;
  void SetTap(Tap tap);
  const std::string& channel_prefix() const;

  /// The connection itself, so that a program can listen or log on it (for memq:// this is the only way in).
  lcm::LCM* lcm() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::io
