// The daemon's log lines, written by a separate thread: a log, terminal or journal that stalls does not block
// the thread that serves commands. Knows nothing of the lines' meaning or destination.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "tendril/core/status.h"

namespace tendril::daemon {

struct Message {
  std::chrono::system_clock::time_point at;  // when it was posted, not when it is written
  Status status = Status::kOk;
  std::string source, text;
};

class Messages {
 public:
  using Write = std::function<void(const Message&)>;
  static constexpr std::size_t kMost = 1000;  // waiting lines; beyond that the newest are dropped and counted

  explicit Messages(Write write);
  /// Gives waiting lines a moment to be written. A thread stuck in `write` is abandoned; the process must
  /// then end soon, without static destruction.
  ~Messages();
  Messages(const Messages&) = delete;
  Messages& operator=(const Messages&) = delete;

  /// Never waits for `write`; may be called from any thread that is not real-time.
  void Post(Status status, std::string source, std::string text);

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace tendril::daemon
