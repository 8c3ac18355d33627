// The daemon: the control cycle on a real-time thread, LCM on the calling thread, queues without locks
// between them. Knows nothing of command lines and signals.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tendril/can/can_port.h"
#include "tendril/core/clock.h"
#include "tendril/core/daemon.h"
#include "tendril/core/robot.h"
#include "tendril/core/status.h"
#include "tendril/io/gateway.h"
#include "tendril/rt/cyclic.h"

namespace tendril::daemon {

struct DaemonOptions {
  DaemonParameters parameters;
  RobotParameters robot;
  std::string log_path;  // LCM log of all messages; empty: none
};

class Daemon {
 public:
  /// Constructs all that may fail, and throws std::exception with one clear line. `port` and `time`, whose
  /// clock stamps the port's frames, must outlive the daemon.
  Daemon(const DaemonOptions& options, can::CanPort& port, rt::Timebase& time = rt::RealTime());
  ~Daemon();

  /// Listens for `listen_ns` before anything is sent; throws std::runtime_error when another daemon answers
  /// on the same LCM channels. A daemon that appears later disarms this one, which refuses to arm until the
  /// other is silent.
  void RefuseOthers(TimeNs listen_ns);

  /// Runs until `stop` (polled about once per millisecond) returns true, then disarms, disables the drives
  /// and returns within 2 s whatever the drives do. Notifies systemd of readiness and status and, as long as
  /// the control cycle advances, its watchdog. Throws std::runtime_error before anything moves when
  /// realtime.required cannot be met.
  void Run(const std::function<bool()>& stop);

  /// Same effect as `stop` returning true, but seen by the control loop directly, whatever Run's thread waits
  /// for. Safe in a signal handler.
  void RequestStop() noexcept;

  /// Logs a line. It is written asynchronously, so a stalled log does not block the caller.
  void Log(Status status, const std::string& text);

  /// The daemon's LCM connection; before Run, or from its calling thread.
  io::Gateway& gateway();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tendril::daemon
