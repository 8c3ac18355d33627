// Lock-free transfer of values from one thread to another: a queue of fixed capacity that drops and counts
// what does not fit. Knows nothing of what it carries.
#pragma once

#if defined(__SANITIZE_THREAD__)
// The thread sanitizer does not see ordering by fences. The queue informs Clang's; this informs GCC's.
#include <sanitizer/tsan_interface.h>
namespace tendril::rt {
inline char fence_seen_by_tsan;
}
#define AE_TSAN_ANNOTATE_RELEASE() __tsan_release(&::tendril::rt::fence_seen_by_tsan)
#define AE_TSAN_ANNOTATE_ACQUIRE() __tsan_acquire(&::tendril::rt::fence_seen_by_tsan)
#endif
#include <readerwriterqueue/readerwriterqueue.h>

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace tendril::rt {

/// One thread pushes, one thread pops. All memory is allocated at construction; neither side ever waits.
template <class T>
class Handoff {
 public:
  /// Room for at least `capacity` values, written once so that no push causes a page fault.
  explicit Handoff(std::size_t capacity) : queue_(capacity) {
    // The first round leaves one place of a block empty; the second fills it.
    for (int round = 0; round < 2; ++round) {
      while (queue_.try_enqueue(T{})) {
      }
      while (queue_.pop()) {
      }
    }
  }

  /// False when it was full: the value is dropped and counted.
  bool TryPush(const T& value) noexcept {
    if (queue_.try_enqueue(value)) return true;
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return false;
  }

  /// The value that TryPop returns next; nullptr when empty. For the popping thread.
  const T* Peek() noexcept { return queue_.peek(); }

  /// False when it was empty.
  bool TryPop(T& value) noexcept { return queue_.try_dequeue(value); }

  std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  moodycamel::ReaderWriterQueue<T> queue_;
  std::atomic<std::uint64_t> dropped_{0};
};

}  // namespace tendril::rt
