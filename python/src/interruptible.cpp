#include "interruptible.h"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <thread>
#include <vector>

namespace tendril::python {
namespace {

namespace nb = nanobind;
using namespace std::chrono_literals;

constexpr auto kLookEvery = 30ms, kWaitForEnd = 500ms;

struct End {
  std::mutex mutex;
  std::condition_variable changed;
  bool here = false;
  std::exception_ptr failure;

  bool Await(std::chrono::milliseconds at_most) {
    std::unique_lock lock(mutex);
    return changed.wait_for(lock, at_most, [this] { return here; });
  }
};

// Only touched with the GIL, or when Python ends.
std::vector<std::thread>& Abandoned() {
  static std::vector<std::thread> threads;
  return threads;
}

}  // namespace

void Work::Report(const std::string& stage, double share) {
  if (stop_) throw Interrupted();
  Tell(stage, share);
}

void Work::Tell(const std::string& stage, double share) {
  const std::lock_guard lock(mutex_);
  if (!reports_.empty() && reports_.back().first == stage) reports_.pop_back();
  reports_.emplace_back(stage, share);
}

std::deque<std::pair<std::string, double>> Work::TakeReports() {
  const std::lock_guard lock(mutex_);
  return std::exchange(reports_, {});
}

void Run(const std::shared_ptr<Work>& work, std::function<void()> body, const nb::object& progress) {
  const auto end = std::make_shared<End>();
  std::thread thread([work, end, body = std::move(body)]() mutable {
    std::exception_ptr failure;
    try {
      body();
    } catch (...) {
      failure = std::current_exception();
    }
    body = nullptr;  // what it owns goes before anybody hears of its end
    const std::lock_guard lock(end->mutex);
    end->failure = failure;
    end->here = true;
    end->changed.notify_all();
  });
  const auto tell = [&] {
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    for (const auto& [stage, share] : work->TakeReports()) {
      if (!progress.is_none()) progress(stage, share);
    }
  };
  try {
    for (bool over = false; !over;) {
      {
        const nb::gil_scoped_release released;
        over = end->Await(kLookEvery);
      }
      tell();
    }
  } catch (...) {
    work->stop_ = true;
    bool over = false;
    {
      const nb::gil_scoped_release released;
      over = end->Await(kWaitForEnd);
      if (over) thread.join();
    }
    if (!over) Abandoned().push_back(std::move(thread));
    throw;
  }
  thread.join();
  if (end->failure) std::rethrow_exception(end->failure);
}

void AwaitAbandoned() {
  std::vector<std::thread> threads = std::exchange(Abandoned(), {});
  const nb::gil_scoped_release released;
  for (std::thread& thread : threads) thread.join();
}

}  // namespace tendril::python
