// What the daemon tells people, written by a thread of its own: a log, terminal or journal that takes nothing
// more holds up nobody who serves commands. Knows nothing of what is told, nor of where it is written.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "tendril/core/status.h"

namespace tendril::daemon {

struct Message {
  std::chrono::system_clock::time_point at;  // when it came up, whenever it is written
  Status status = Status::kOk;
  std::string source, text;
};

class Messages {
 public:
  using Write = std::function<void(const Message&)>;
  static constexpr std::size_t kMost = 1000;  // that wait; of more the newest are dropped, and counted

  explicit Messages(Write write);
  /// Gives what waits a moment to be written. A thread that is stuck in `write` then is left to itself: let
  /// the process end soon, and without running what is static down.
  ~Messages();
  Messages(const Messages&) = delete;
  Messages& operator=(const Messages&) = delete;

  /// Never waits for `write`; may be called from any thread that need not be real-time.
  void Post(Status status, std::string source, std::string text);

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace tendril::daemon
