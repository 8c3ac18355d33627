// What the kernel did to the calling thread: switches away from it and pages fetched for it. Knows nothing of
// the loop.
#pragma once

#include <cstdint>

namespace tendril::rt {

struct ThreadUsage {
  std::uint64_t voluntary_switches = 0, involuntary_switches = 0, minor_faults = 0, major_faults = 0;
};

/// Of the calling thread since it began; a system call that never waits.
ThreadUsage ReadThreadUsage() noexcept;

/// The sum of what happened between each Begin and End, less what was excused in between.
class UsageMeter {
 public:
  void Begin() noexcept { from_ = ReadThreadUsage(); }
  /// `wait` may give up the CPU: its voluntary switches do not count.
  template <class Wait>
  auto Excuse(Wait&& wait) noexcept {
    const std::uint64_t before = ReadThreadUsage().voluntary_switches;
    const auto result = wait();
    from_.voluntary_switches += ReadThreadUsage().voluntary_switches - before;
    return result;
  }
  void End() noexcept;
  const ThreadUsage& sum() const noexcept { return sum_; }

 private:
  ThreadUsage from_, sum_;
};

}  // namespace tendril::rt
