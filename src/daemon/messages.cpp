// The queue of lines and the thread that writes them; see the header.
#include "tendril/daemon/messages.h"

#include <fmt/format.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace tendril::daemon {
namespace {

constexpr std::chrono::milliseconds kLastMoment{100};

}  // namespace

struct Messages::State {
  // Writes until the queue is empty after the end.
  void WriteAll() {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [this] { return ended || !waiting.empty(); });
      if (waiting.empty()) break;
      const Message next = std::move(waiting.front());
      waiting.pop_front();
      const std::uint64_t lost = std::exchange(dropped, 0);
      lock.unlock();
      write(next);
      if (lost > 0) {
        write({std::chrono::system_clock::now(), Status::kDegraded, "daemon",
               fmt::format("{} line(s) were dropped because this log was not read", lost)});
      }
      lock.lock();
    }
    done = true;
    changed.notify_all();
  }

  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Message> waiting;
  std::uint64_t dropped = 0;
  bool ended = false, done = false;
  Write write;
};

Messages::Messages(Write write) : state_(std::make_shared<State>()) {
  state_->write = std::move(write);
  std::thread([state = state_] { state->WriteAll(); }).detach();
}

Messages::~Messages() {
  std::unique_lock lock(state_->mutex);
  state_->ended = true;
  state_->changed.notify_all();
  state_->changed.wait_for(lock, kLastMoment, [this] { return state_->done; });
}

void Messages::Post(Status status, std::string source, std::string text) {
  const std::lock_guard lock(state_->mutex);
  if (state_->waiting.size() >= kMost) {
    ++state_->dropped;
    return;
  }
  state_->waiting.push_back({std::chrono::system_clock::now(), status, std::move(source), std::move(text)});
  state_->changed.notify_all();
}

}  // namespace tendril::daemon
