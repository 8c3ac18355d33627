// Runs independent work items on all cores. Knows nothing of what the work is.
#pragma once

#include <algorithm>
#include <atomic>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace tendril {

inline int AllCores() { return std::max(1, static_cast<int>(std::thread::hardware_concurrency())); }

/// Calls work(i) for i = 0..count-1 on `threads` threads; each call writes only its own results, so the
/// outcome does not depend on the order. When calls throw, the exception of the lowest i is rethrown after
/// all threads have ended; all items below it have been called.
inline void ParallelFor(int count, int threads, const std::function<void(int)>& work) {
  std::atomic<int> next{0};
  std::exception_ptr failure;
  int failed = count;
  std::mutex guard;
  const auto run = [&] {
    for (int i = next++; i < count; i = next++) {
      try {
        work(i);
      } catch (...) {
        const std::lock_guard lock(guard);
        if (i < failed) failed = i, failure = std::current_exception();
        next = count;
      }
    }
  };
  std::vector<std::thread> others;
  for (int t = 1; t < std::min(threads, count); ++t) others.emplace_back(run);
  run();
  for (auto& thread : others) thread.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace tendril
