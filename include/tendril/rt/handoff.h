// Values from one thread to one other without locks: a queue of fixed capacity that drops what does not fit
// and counts it. Knows nothing of what it carries.
#pragma once

#if defined(__SANITIZE_THREAD__)
// The thread sanitizer does not see what fences order. The queue tells Clang's; this tells GCC's.
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

/// One thread pushes, one thread pops. All memory is taken at construction; neither side ever waits.
template <class T>
class Handoff {
 public:
  /// Room for at least `capacity` values; all of it has been written to, so that no push fetches a page.
  explicit Handoff(std::size_t capacity) : queue_(capacity) {
    // A block leaves one place empty, another one in the next round.
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

  /// What TryPop gives next; nullptr when it is empty. Of the thread that pops.
  const T* Peek() noexcept { return queue_.peek(); }

  /// False when it was empty.
  bool TryPop(T& value) noexcept { return queue_.try_dequeue(value); }

  std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  moodycamel::ReaderWriterQueue<T> queue_;
  std::atomic<std::uint64_t> dropped_{0};
};

}  // namespace tendril::rt
