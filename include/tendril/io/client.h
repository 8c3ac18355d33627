// The other end of the gateway: sends commands, listens to state and events. For programs that operate a
// daemon, and for anything that commands a controller in the same process. Knows nothing of control.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "tendril/core/cycle.h"

namespace lcm {
class LCM;
}
namespace tendril_lcm {
class state_t;
class event_t;
class statistics_t;
class run_t;
}  // namespace tendril_lcm

namespace tendril::io {

class Client {
 public:
  using StateSink = std::function<void(const tendril_lcm::state_t&)>;
  using EventSink = std::function<void(const tendril_lcm::event_t&)>;
  using RunSink = std::function<void(const tendril_lcm::run_t&)>;
  using StatisticsSink = std::function<void(const tendril_lcm::statistics_t&)>;

  /// A connection of its own. Throws std::runtime_error with the remedy when it cannot be opened.
  Client(const std::string& url, const std::string& channel_prefix);
  /// On an existing connection (for example Gateway::lcm()), which must outlive the client.
  Client(lcm::LCM* lcm, const std::string& channel_prefix);
  ~Client();

  /// Called in Handle; must not throw.
  void OnState(StateSink sink);
  void OnEvent(EventSink sink);
  void OnStatistics(StatisticsSink sink);
  void OnRun(RunSink sink);

  /// "waiting: ...": what a daemon whose networks are not there yet tells once a second in place of states.
  /// Empty until it was heard in Handle.
  const std::string& waits() const noexcept;

  /// Publishes the command on its channel, kind kNone excepted. `utime` [us since the epoch] is when it was
  /// given, 0: the time of arrival counts. received_ns of the command is not sent. False when publishing
  /// failed.
  bool Send(const Command& command, std::int64_t utime);

  /// As Gateway::Handle.
  int Handle(int timeout_ms);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Sequence number for senders that do not live on: ticks of 10 us since the epoch, so that whoever sends
/// later has the greater number. It wraps every 12 hours; the gate compares with numbers of the last hour
/// only.
std::uint32_t SequenceFromTime();

/// Command::sender of whoever sends from this process: its number, and above that something of the host's
/// name.
std::uint32_t SenderOfProcess();
/// The sequence number that a message carries for a command: above its own that of its sender.
std::int64_t SequenceOf(const Command& command);
std::uint32_t SenderOf(std::int64_t sequence);
/// For people: "process 4711"; of what is no program of Tendril's on this host "sender 121".
std::string SenderText(std::uint32_t sender);

/// Why the robot is in its mode, of all that a state reports; Ok where nothing but commands led there.
Status ReasonForMode(const tendril_lcm::state_t& state);

}  // namespace tendril::io
