// What the daemon owes systemd: its log lines in the journal, and a watchdog that is fed while the control
// cycle advances. Without systemd both do what a plain program does. Knows nothing of robots.
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>

#include "tendril/daemon/messages.h"

namespace tendril::daemon {

/// Writes a log line: under systemd with searchable fields (journalctl TENDRIL_STATUS=406), else as a plain
/// message.
void WriteLogLine(const Message& message);

/// Feeds systemd's watchdog, if any, while `tick` advances. Runs in its own thread: the serving thread may
/// wait for a log or a disk, and the loop then needs time to ramp the tensions down (318).
class WatchdogFeeder {
 public:
  explicit WatchdogFeeder(const std::atomic<std::uint64_t>& tick);

 private:
  std::jthread thread_;
};

}  // namespace tendril::daemon
