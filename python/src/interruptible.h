// Long work without the GIL that Ctrl-C ends at once, with progress on the caller's thread. Knows nothing of
// the work.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>

namespace tendril::python {

/// Thrown in the work where it hears that it shall end.
class Interrupted : public std::runtime_error {
 public:
  Interrupted() : std::runtime_error("interrupted") {}
};

/// What work and caller share; kept alive by both.
class Work {
 public:
  bool stopped() const { return stop_; }
  const std::atomic<bool>* stop() const { return &stop_; }
  /// From any thread of the work: a stage and its completed share. Throws Interrupted once it shall end.
  void Report(const std::string& stage, double share);
  /// The same without throwing, for work that hears of `stop` otherwise.
  void Tell(const std::string& stage, double share);

 private:
  friend void Run(const std::shared_ptr<Work>&, std::function<void()>, const nanobind::object&);
  std::deque<std::pair<std::string, double>> TakeReports();

  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::deque<std::pair<std::string, double>> reports_;
};

/// Calls `body` on a thread of its own. Until it returns, this thread serves signals and calls
/// `progress(stage, share)` unless None; what either raises ends the work and is raised here, at the latest
/// half a second afterwards: work that takes longer to hear of it ends by itself. So `body` owns all that it
/// uses. What it throws is thrown here.
void Run(const std::shared_ptr<Work>& work, std::function<void()> body, const nanobind::object& progress);

/// Waits for all such work.
void AwaitAbandoned();

}  // namespace tendril::python
