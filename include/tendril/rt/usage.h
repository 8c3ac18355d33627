// The kernel's involuntary costs of the calling thread: context switches and page faults. Knows nothing of
// the loop.
#pragma once

#include <cstdint>

namespace tendril::rt {

struct ThreadUsage {
  std::uint64_t voluntary_switches = 0, involuntary_switches = 0, minor_faults = 0, major_faults = 0;
};

/// Usage of the calling thread since its start; a system call that never waits.
ThreadUsage ReadThreadUsage() noexcept;

/// Sum of the usage between each Begin and End, less what was excused in between.
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
