// One command to a daemon, and what became of it. Knows nothing of the robot: the daemon judges.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "tendril/core/cycle.h"
#include "tendril/io/client.h"
#include "tendril/io/signature.h"

namespace tendril::io {

struct CommandCall {
  std::string url, channel_prefix;
  Command command;  // without sender and sequence number
  /// For the daemon's answer [s]; to arm, for daemon and drives to be ready and pretension, too. 0: does not
  /// wait.
  double timeout_s = 0;
  /// From another thread: what is waited for is not waited for any more, and what was not sent yet is not
  /// sent.
  const std::atomic<bool>* stop = nullptr;
  std::string key = KeyOfEnvironment();  // that signs it; empty: it is not signed
};

/// Sends it and waits for its answer; an arm first for a daemon and drives that are still starting, and then
/// until targets are taken. Returns a line on where the robot is now; empty with a timeout of 0. What is
/// waited for and does not come soon goes to `waiting` ("the drives: ..."). Throws std::runtime_error with
/// reason and remedy when nobody answers, the daemon refuses, or an arm ends elsewhere.
std::string SendCommand(const CommandCall& call, const std::function<void(const std::string&)>& waiting);

/// "accepted; mode hold", which limits act, and how far the requested point is away.
std::string AcceptedText(const tendril_lcm::state_t& state);
/// Why the command was refused, with what else the daemon reports and its remedies.
std::string RefusedText(const tendril_lcm::state_t& state);

}  // namespace tendril::io
