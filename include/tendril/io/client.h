// Client side of the gateway: sends commands, receives state and events. For programs that operate a daemon,
// and for anything that commands a controller in the same process. Knows nothing of control.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/io/signature.h"

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

  /// Opens its own connection, and signs with this key; empty: not. Throws std::runtime_error with the remedy
  /// when the connection, or the key file of the environment, cannot be opened.
  Client(const std::string& url, const std::string& channel_prefix,
         const std::string& key = KeyOfEnvironment());
  /// On an existing connection (for example Gateway::lcm()), which must outlive the client.
  Client(lcm::LCM* lcm, const std::string& channel_prefix, const std::string& key = KeyOfEnvironment());
  ~Client();

  /// Called in Handle; must not throw.
  void OnState(StateSink sink);
  void OnEvent(EventSink sink);
  void OnStatistics(StatisticsSink sink);
  void OnRun(RunSink sink);

  /// "waiting: ...": published once per second, in place of states, by a daemon whose networks are not up
  /// yet. Empty until received in Handle.
  const std::string& waits() const noexcept;

  /// The gateway's last reason to ignore a command of anybody, as "TENDRIL_COMMAND_MODE: message ignored:
  /// ..."; empty: none in Handle so far.
  const std::string& ignored() const noexcept;
  /// Publishes the command on its channel, except kind kNone, signed where the client has a key.
  /// `utime` [us since the epoch] is the time of the command, 0: its time of arrival. received_ns of the
  /// command is not sent. False when publishing failed.
  bool Send(const Command& command, std::int64_t utime);

  /// As Gateway::Handle.
  int Handle(int timeout_ms);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// A program's error when no daemon answered it within some time; a daemon that waits for its networks
/// reports that.
std::string NobodyAnswers(const std::string& url, const std::string& channel_prefix, double within_s,
                          const Client& client);

/// Publishes a tracker's reading on `channel` (PREFIX_TRACKER), as the computer of a tracker does. `utime`
/// [us since the epoch; in simulation: simulated time] is the time of measurement. False when publishing
/// failed.
bool SendTracker(lcm::LCM& lcm, const std::string& channel, const TrackerSample& sample, std::int64_t utime);

/// Publishes the command now, with this process as its sender and its next sequence number, which are set in
/// it. Commands of several clients and threads are numbered in the order in which they are sent. `url` is the
/// client's, for the error. Returns the sequence number by which states answer it. Throws std::runtime_error
/// when LCM does not take it.
std::int64_t Publish(Client& client, Command& command, const std::string& url);

/// A sequence number above all earlier ones of this process: ticks of 10 us since the epoch, so that it is
/// also above those of an earlier process with the same id. It wraps every 12 hours; the gate compares with
/// numbers of the last hour only.
std::uint32_t NextSequence();

/// Command::sender of this process: its process id, with bits of the host's name above it.
std::uint32_t SenderOfProcess();
/// The sequence number of a command's message: the command's own number below that of its sender.
std::int64_t SequenceOf(const Command& command);
std::uint32_t SenderOf(std::int64_t sequence);
/// Text for a sender: "process 4711"; "sender 121" when it is no Tendril program on this host.
std::string SenderText(std::uint32_t sender);

/// The reported status that explains the robot's mode; Ok when only commands led to it.
Status ReasonForMode(const tendril_lcm::state_t& state);

}  // namespace tendril::io
