#include "stop_signals.h"

#include <csignal>

namespace tendril::tools {
namespace {

std::atomic<bool> stopped = false;
std::atomic<int> last_signal = 0;
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free,
              "a signal handler takes no lock");

void Take(int signal) {
  last_signal = signal;
  stopped = true;
}

}  // namespace

const std::atomic<bool>& CatchStopSignals() {
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, Take);
  // Below nohup a program outlives its terminal.
  if (std::signal(SIGHUP, Take) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);
  return stopped;
}

std::string StoppedBy() {
  switch (last_signal) {
    case SIGINT:
      return "Ctrl-C";
    case SIGTERM:
      return "SIGTERM";
    case SIGHUP:
      return "SIGHUP";
    default:
      return {};
  }
}

}  // namespace tendril::tools
